// The connection to the server: it reconnects to the same session, and knows the server's clock.

const KEPT = "acromion-live";
const FIRST_WAIT_MS = 250, LONGEST_WAIT_MS = 4000, PING_MS = 2000, EARLY_PING_MS = 200, GOOD_MS = 50, SLACK_MS = 5;
const MOST_BUFFERED = 1 << 20, MOST_KEPT = 60 * 120 * 80;

export class Link {
  constructor(address, language, take) {
    Object.assign(this, { address, language, take, session: null, waitMs: FIRST_WAIT_MS, offsetMs: 0, quickestMs: Infinity, kept: [], keptBytes: 0, isKnown: false, isOver: true });
  }

  // Return the session that was open when the page was left or reloaded.
  static remembered() {
    return sessionStorage.getItem(KEPT);
  }

  // Send bytes of a sensor, or keep the last minute of them while the connection is lost.
  push(bytes) {
    if (this.isOpen && this.isKnown && this.socket.bufferedAmount < MOST_BUFFERED) {
      this.socket.send(bytes);
      return;
    }
    this.kept.push(bytes);
    this.keptBytes += bytes.length;
    while (this.keptBytes > MOST_KEPT) this.keptBytes -= this.kept.shift().length;
  }

  flush() {
    this.isKnown = true;
    for (const bytes of this.kept.splice(0)) this.socket.send(bytes);
    this.keptBytes = 0;
  }

  start(asked) {
    this.open({ type: "start", lang: this.language, ...asked });
  }

  resume(session) {
    this.session = session;
    this.open({ type: "resume", session, lang: this.language });
  }

  open(first) {
    this.isOver = false;
    this.socket = new WebSocket(this.address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.waitMs = FIRST_WAIT_MS;
      this.send(first);
      this.ping();
      if (first.source === "lines") this.flush(); // the server reads header and rate from them
    };
    this.socket.onmessage = (event) => this.handleMessage(JSON.parse(event.data));
    this.socket.onclose = () => this.handleClose();
  }

  send(message) {
    if (this.isOpen) this.socket.send(JSON.stringify(message));
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  ping() {
    clearTimeout(this.timer);
    const waitMs = this.quickestMs < GOOD_MS ? PING_MS : EARLY_PING_MS;
    this.send({ type: "ping", sent_ms: performance.timeOrigin + performance.now() });
    this.timer = setTimeout(() => this.ping(), waitMs);
  }

  handleMessage(message) {
    if (message.type === "pong") {
      const nowMs = performance.timeOrigin + performance.now(), tookMs = nowMs - message.sent_ms;
      if (tookMs > this.quickestMs + SLACK_MS) return; // a slow response gives an inaccurate clock offset
      this.quickestMs = Math.min(tookMs, this.quickestMs);
      this.offsetMs = message.server_s * 1000 - (message.sent_ms + nowMs) / 2;
      return;
    }
    if (message.type === "session") {
      this.session = message.session;
      sessionStorage.setItem(KEPT, message.session);
      this.flush();
    }
    if (message.type === "ended" || message.type === "problem") this.forget();
    this.take(message);
  }

  // Return the milliseconds since a time on the server's clock.
  since(serverS) {
    return performance.timeOrigin + performance.now() + this.offsetMs - serverS * 1000;
  }

  forget() {
    this.isOver = true;
    sessionStorage.removeItem(KEPT);
    clearTimeout(this.timer);
  }

  handleClose() {
    this.isKnown = false;
    clearTimeout(this.timer);
    if (this.isOver) return;
    this.take({ type: "lost" });
    if (!this.session) return;
    setTimeout(() => this.resume(this.session), this.waitMs);
    this.waitMs = Math.min(2 * this.waitMs, LONGEST_WAIT_MS);
  }
}
