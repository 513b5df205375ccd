// All chosen files: three on their way at a time, the others wait. The analysis of each is declared when its
// upload begins, and starts with the last byte, whether or not this page is still open.

import { $, fill, rest, say } from "../say.js";
import { forget, recall, fingerprint } from "./memory.js";
import { Row } from "./row.js";
import { giveUp, Refusal, TUS, TusUpload } from "./tus.js";
import { tellSize } from "./sizes.js";

const AT_ONCE = 3;
const LOOK_MS = 400;
const MOST_LOOKS = 20;
const MOST_TRIES = 12;
const LONGEST_PAUSE_MS = 20000;

export class Queue {
  constructor(api, onChange, onAdded) {
    Object.assign(this, { api, onChange, onAdded, waiting: [], going: new Set(), all: new Set() });
  }

  add(files, wishes) {
    for (const file of files) {
      const entry = { file };
      const kept = recall()[fingerprint(file)] || {}; // said before a reload
      const said = { subject: wishes.subject || kept.subject || "", side: wishes.side || kept.side || "" };
      entry.study = wishes.study || kept.study || "";
      entry.held = wishes.held || kept.held || ""; // "start": the pose was held at the start of wear
      entry.row = new Row(file, said, { cancel: () => this.cancel(entry), retry: () => this.retry(entry), remove: () => this.remove(entry) });
      this.all.add(entry);
      this.waiting.push(entry);
    }
    this.next();
  }

  get isBusy() {
    return this.going.size + this.waiting.length > 0;
  }

  // Of each file that is not refused nor here already: its name, and the key of its row in the list, "" before
  // that is known (the analysis may begin before the page hears of the recording).
  get open() {
    return [...this.all].filter(({ row }) => !row.isOver).map((entry) => ({ key: entry.key || "", name: entry.file.name }));
  }

  next() {
    while (this.going.size < AT_ONCE && this.waiting.length) this.start(this.waiting.shift());
    this.onChange();
  }

  async start(entry) {
    const { row, file } = entry;
    const words = row.words;
    if (file.size > Number(words.maxBytes)) return this.refuseLarge(entry);
    this.going.add(entry);
    row.show("uploading");
    row.part(".asked").addEventListener("change", () => this.tell(entry));
    entry.upload = new TusUpload(file, row.wishes(), { study: entry.study, held: entry.held }, this.api + "/uploads", {
      progress: (bytes) => (row.state === "lost" && row.show("uploading"), row.progress(bytes)),
      piece: () => this.look(entry),
      smaller: (bytes) => row.note(fill(words.smaller, { size: tellSize(bytes, row.units) })),
      waiting: () => row.show("lost"),
      resumed: () => this.tell(entry),
    });
    try {
      const recordingId = await entry.upload.send();
      await this.persist(entry, () => this.hand(entry, recordingId));
    } catch (error) {
      if (!entry.upload.stopped) error instanceof Refusal ? row.refuse(error.problem) : row.loseNetwork();
    }
    this.going.delete(entry);
    this.next();
  }

  // What is said while the file comes is told to the server at once, for its analysis begins by itself.
  tell({ file, row, upload }) {
    const { subject, side } = row.wishes();
    const body = JSON.stringify({ file_name: file.name, subject, side: side || null });
    if (upload.address) fetch(upload.address + "/words", { method: "PUT", headers: { "Content-Type": "application/json" }, body }).catch(() => null);
  }

  // A network that is lost when all bytes are safe loses nothing: the server is asked until it answers.
  async persist(entry, act) {
    for (let tries = 1; ; tries += 1) {
      try {
        return await act();
      } catch (error) {
        if (error instanceof Refusal || tries > MOST_TRIES || entry.isCancelled) throw error;
        entry.row.show("lost");
        await rest(Math.min(500 * 2 ** tries, LONGEST_PAUSE_MS));
      }
    }
  }

  refuseLarge({ row, file }) {
    const { tooBig, tooBigDetail, tooBigFix, maxBytes } = row.words;
    const facts = { size: tellSize(file.size, row.units), max: tellSize(Number(maxBytes), row.units) };
    row.refuse({ title: tooBig, detail: fill(tooBigDetail, facts), fix: tooBigFix, code: "E-BIG", retryable: false });
  }

  // Ask what the first bytes show, until they show it.
  async look(entry) {
    if (entry.looked) return;
    entry.looked = true;
    for (let k = 0; k < MOST_LOOKS && !entry.upload.stopped; k += 1) {
      const answer = await fetch(entry.upload.address + "/inspection").catch(() => null);
      if (answer && answer.status >= 400) return this.warn(entry, answer);
      const found = answer ? await answer.json() : {};
      if (found.device) return entry.row.understand(this.describe(found, entry.row.words));
      await new Promise((resolve) => setTimeout(resolve, LOOK_MS));
    }
  }

  // No recording by its first bytes: said at once, so that nobody waits for the rest; the analysis will say more.
  async warn({ row }, answer) {
    const { title, fix } = await answer.json().catch(() => ({}));
    if (answer.status === 422 && title) row.note(`${title}. ${fix}`);
  }

  describe(found, words) {
    const rate = found.rate_hz ? `${Math.round(found.rate_hz).toLocaleString(document.documentElement.lang)} Hz` : "";
    const start = (found.start || "").slice(0, 16).replace("T", " ");
    const zone = found.start && found.time_zone ? `(${found.time_zone})` : "";
    const device = JSON.parse(words.devices)[found.device] || found.device;
    return [device, rate, [start, zone].filter(Boolean).join(" ")].filter(Boolean).join(" · ");
  }

  // The bytes are safe, and the analysis has begun, unless other bytes alike have one or no more may wait: then
  // it is asked for here. Until it is known to be there, the file is remembered.
  async hand(entry, recordingId) {
    entry.key = `of-${recordingId}`;
    const recording = await this.get(`/recordings/${recordingId}`);
    const begun = (await this.get(`/analyses?recording_id=${recordingId}&limit=1`)).items[0];
    const upload = await this.get(`/uploads/${entry.upload.address.split("/").pop()}`);
    if (upload.is_repeated) return this.handRepeated(entry, recordingId, begun, upload);
    const { subject, side } = entry.row.wishes();
    const isAsSaid = subject === recording.subject && side === (recording.side || "");
    if (begun && isAsSaid) return this.added(entry);
    if (begun) await this.send("POST", `/analyses/${begun.id}/cancel`); // what was said last came too late
    if (recording.duplicate_of) {
      const earlier = await this.get(`/analyses?recording_id=${recording.duplicate_of}&limit=1`);
      if (earlier.items.some(({ state }) => !["failed", "cancelled"].includes(state))) {
        await this.drop(entry, recordingId);
        if (entry.study) await this.send("POST", "/analyses", { recording_ids: [recording.duplicate_of], study: entry.study });
        return this.offer(entry, recording.duplicate_of, earlier.items[0]);
      }
    }
    if (entry.isCancelled) return this.drop(entry, recordingId);
    if (!isAsSaid) {
      const read = { "If-Match": `"${recording.version}"` };
      await this.send("PATCH", `/recordings/${recordingId}`, { subject, side: side || null }, read);
    }
    await this.send("POST", "/analyses", { recording_ids: [recordingId], settings: this.settings(entry), study: entry.study });
    this.added(entry);
  }

  // The same file was sent before: its recording is never taken away here.
  async handRepeated(entry, recordingId, begun, upload) {
    if (begun && begun.created_at >= upload.created_at) return this.added(entry);
    if (begun && !["failed", "cancelled"].includes(begun.state)) {
      forget(entry.file);
      if (entry.study) await this.send("POST", "/analyses", { recording_ids: [recordingId], study: entry.study });
      return this.offer(entry, recordingId, begun);
    }
    if (entry.isCancelled) return forget(entry.file);
    await this.send("POST", "/analyses", { recording_ids: [recordingId], settings: this.settings(entry), study: entry.study });
    this.added(entry);
  }

  async drop(entry, recordingId) {
    await this.erase(recordingId);
    forget(entry.file);
  }

  // For good; into the trash where somebody may not do that, or logged in too long ago.
  async erase(recordingId) {
    const address = `${this.api}/recordings/${recordingId}`;
    const answer = await fetch(`${address}?purge=now`, { method: "DELETE" });
    if (answer.status === 403) await fetch(address, { method: "DELETE" });
  }

  // Whether an upload is whole and its analysis has begun.
  async isBegun(address) {
    if (!address) return false;
    const answer = await fetch(address, { method: "HEAD", headers: TUS }).catch(() => null);
    const recordingId = answer?.headers.get("Acromion-Recording");
    const found = recordingId && (await this.get(`/analyses?recording_id=${recordingId}&limit=1`).catch(() => null));
    return Boolean(found?.items.length);
  }

  // Of an upload that nobody wants any more nothing is kept, nor the recording it became, unless that is analysed.
  async leave(address) {
    const answer = await fetch(address, { method: "HEAD", headers: TUS }).catch(() => null);
    const recordingId = answer?.headers.get("Acromion-Recording");
    await giveUp(address);
    if (answer?.headers.get("Acromion-Repeated")) return;
    const found = recordingId && (await this.get(`/analyses?recording_id=${recordingId}&limit=1`).catch(() => null));
    if (!found || found.items.length) return;
    await this.erase(recordingId).catch(() => null);
  }

  offer(entry, recordingId, { id, created_at: when }) {
    const page = this.api.replace(/\/api\/v1$/, "") + `/analyses/${id}`;
    entry.row.duplicate({ page, when: when.slice(0, 10) }, () => this.repeat(entry, recordingId));
  }

  async repeat(entry, recordingId) {
    const { row } = entry;
    const said = Object.entries(row.wishes()).filter(([, value]) => value); // the rest is as it was
    const settings = { ...this.settings(entry), ...Object.fromEntries(said) };
    try {
      await this.send("POST", "/analyses", { recording_ids: [recordingId], settings, again: true, study: entry.study });
      this.added(entry);
    } catch (error) {
      const problem = error instanceof Refusal ? error.problem : { title: row.words.network, fix: row.words.networkFix };
      row.note(`${problem.title}. ${problem.fix}`);
    }
  }

  settings({ held }) {
    return { lang: document.documentElement.lang, ...(held && { pose_held: held }) };
  }

  added(entry) {
    forget(entry.file);
    say(fill(entry.row.words.added, { name: entry.file.name }));
    this.onAdded().finally(() => this.remove(entry));
  }

  async get(path) {
    return this.send("GET", path);
  }

  async send(method, path, body, more = {}) {
    const headers = { ...(body && { "Content-Type": "application/json" }), ...more };
    const answer = await fetch(this.api + path, { method, headers, body: body && JSON.stringify(body) });
    const told = await answer.json();
    if (!answer.ok) throw new Refusal(told);
    return told;
  }

  cancel(entry) {
    entry.isCancelled = true;
    entry.upload?.stop();
    this.waiting = this.waiting.filter((other) => other !== entry);
    this.remove(entry);
    this.onChange();
  }

  retry(entry) {
    entry.looked = false;
    entry.row.show("waiting");
    this.waiting.push(entry);
    this.next();
  }

  get failed() {
    return [...this.all].filter((entry) => entry.row.state === "refused" && entry.row.isRetryable);
  }

  retryAll() {
    for (const entry of this.failed) this.retry(entry);
  }

  remove(entry) {
    this.all.delete(entry);
    entry.row.remove();
    this.onChange();
  }
}
