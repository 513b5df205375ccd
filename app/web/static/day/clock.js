// Moments of the recording, between seconds and what people read and type. The server reads them again.

const DAY_S = 86400;

export class Clock {
  // start: ISO 8601 or "" where the recording has no clock; dated: whether an hour alone may mean two days.
  constructor(start, durationS, dated) {
    this.durationS = durationS;
    this.dated = dated;
    const parts = /^(\d{4}-\d{2}-\d{2})T(\d{2}):(\d{2}):(\d{2}(?:\.\d+)?)/.exec(start);
    this.hasClock = Boolean(parts);
    this.day = parts ? Date.parse(parts[1] + "T00:00:00Z") : 0;
    this.startS = parts ? Number(parts[2]) * 3600 + Number(parts[3]) * 60 + Number(parts[4]) : 0;
  }

  tell(second, digits = 2) {
    const rounded = Math.round(second * 10 ** digits) / 10 ** digits;
    if (!this.hasClock) return String(rounded);
    const whole = this.startS + rounded;
    const days = Math.floor(whole / DAY_S);
    const inDay = whole - days * DAY_S;
    const seconds = (inDay % 60).toFixed(digits).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, "");
    const hour = [Math.floor(inDay / 3600), Math.floor((inDay % 3600) / 60)].map(pad).join(":");
    const time = hour + ":" + (seconds.split(".")[0].length < 2 ? "0" + seconds : seconds);
    return this.dated ? new Date(this.day + days * DAY_S * 1000).toISOString().slice(0, 10) + " " + time : time;
  }

  // Seconds from the first sample, or NaN for what is no moment of this recording.
  read(text) {
    const told = text.trim().replace(",", ".");
    if (/^\d+(\.\d+)?$/.test(told)) return this.check(Number(told));
    const parts = /^(?:(\d{4}-\d{2}-\d{2})[ T])?(\d{1,2})\s?[:hH]\s?(\d{2})(?::(\d{2}(?:\.\d+)?))?$/.exec(told);
    if (!parts || !this.hasClock) return NaN;
    const inDay = Number(parts[2]) * 3600 + Number(parts[3]) * 60 + Number(parts[4] || 0);
    if (parts[1]) return this.check((Date.parse(parts[1] + "T00:00:00Z") - this.day) / 1000 + inDay - this.startS);
    const second = inDay - this.startS;
    return this.check(second < -0.01 ? second + DAY_S : second);
  }

  check(second) {
    return second >= -0.01 && second <= this.durationS + 0.01 ? Math.min(Math.max(second, 0), this.durationS) : NaN;
  }

  // At most so many round moments of a view, for the axis: [second, text].
  marks(fromS, toS, most) {
    const steps = [0.01, 0.05, 0.1, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 14400, 43200, 86400];
    const step = steps.find((candidate) => (toS - fromS) / candidate <= most) || 86400;
    const first = Math.ceil((fromS + this.startS) / step) * step - this.startS;
    const marks = [];
    for (let at = first; at <= toS; at += step) marks.push([at, this.mark(at, step)]);
    return marks;
  }

  mark(second, step) {
    const told = this.tell(second);
    if (!this.hasClock || step < 60) return told;
    return told.replace(/:\d\d(\.\d+)?$/, "").slice(step >= DAY_S ? 0 : this.dated ? 5 : 0);
  }
}

function pad(number) {
  return String(number).padStart(2, "0");
}
