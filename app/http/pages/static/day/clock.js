// Convert between seconds and the times that people read and type. The server parses the times again.

import { formatClock, isFrench, pad } from "../times.js";

const DAY_S = 86400;
const MARK_PX = 85;
const SECONDS_PX = isFrench ? 130 : MARK_PX;
const SECOND = "(?<second>[0-9]{2}(?:[.,][0-9]{1,6})?)";
// 10:20, 10h20, 10.20 and 1020, as in parse_clock in fusion/diary.py.
const SPELLINGS = [
  `(?<hour>[0-9]{1,2})\\s?:\\s?(?<minute>[0-9]{2})(?:\\s?:\\s?${SECOND})?`,
  `(?<hour>[0-9]{1,2})\\s?h(?:\\s?(?<minute>[0-9]{2})(?:\\s?(?:m|mn|min|:)\\s?${SECOND}\\s?s?|\\s?(?:m|mn|min))?)?`,
  `(?<hour>[0-9]{1,2})(?<dot>[.,])(?<minute>[0-9]{2})(?:\\k<dot>${SECOND})?`,
  `(?<hour>[0-9]{2})(?<minute>[0-9]{2})(?:${SECOND})?`,
].map((spelling) => new RegExp(`^(?:${spelling})$`, "i"));
const DAY_FRACTION = /^(?:0?|[0-9]{5})[.,][0-9]+$/;

// Return seconds since midnight, or NaN if the text is not a clock time.
function readClock(text) {
  const match = DAY_FRACTION.test(text) ? null : SPELLINGS.map((spelling) => spelling.exec(text)).find(Boolean);
  if (!match) return NaN;
  const [hour, minute, second] = ["hour", "minute", "second"].map((name) => Number((match.groups[name] || "0").replace(",", ".")));
  return hour < 24 && minute < 60 && second < 60 ? hour * 3600 + minute * 60 + second : NaN;
}

export class Clock {
  // start: ISO 8601, or "" if the recording has no clock; dated: whether a typed time without a date is ambiguous;
  // changes: JSON of the changes of its time zone, [[second, step in s], ...], also those just outside.
  constructor(start, durationS, dated, changes) {
    this.durationS = durationS;
    this.changes = JSON.parse(changes || "[]");
    const offset = /([+-])(\d{2}):(\d{2})$/.exec(start);
    this.offsetS = offset ? Number(offset[1] + 1) * (Number(offset[2]) * 3600 + Number(offset[3]) * 60) : 0;
    this.dated = dated;
    const parts = /^(\d{4}-\d{2}-\d{2})T(\d{2}):(\d{2}):(\d{2}(?:\.\d+)?)/.exec(start);
    this.hasClock = Boolean(parts);
    this.day = parts ? Date.parse(parts[1] + "T00:00:00Z") : 0;
    this.startS = parts ? Number(parts[2]) * 3600 + Number(parts[3]) * 60 + Number(parts[4]) : 0;
    this.spansMidnight = this.startS + durationS >= DAY_S;
  }

  // Return a time for a field, "07:05:09".
  format(second, digits = 2) {
    if (!this.hasClock) return String(round(second, digits));
    const { date, inDay } = this.place(second, digits);
    const seconds = (inDay % 60).toFixed(digits).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, "");
    const hour = [Math.floor(inDay / 3600), Math.floor((inDay % 3600) / 60)].map(pad).join(":");
    const time = hour + ":" + (seconds.split(".")[0].length < 2 ? "0" + seconds : seconds);
    const offset = this.find(date, inDay).length > 1 ? this.offset(second) : "";
    return this.dated || offset ? `${date} ${time}${offset}` : time;
  }

  // Return how far the changes of the zone have moved the clock since the first sample, in s.
  moved(second) {
    return this.changes.reduce((sum, [at, step]) => sum + step * ((second >= at) - (at <= 0)), 0);
  }

  // Return the offset from UTC, "+02:00".
  offset(second) {
    const minutes = (this.offsetS + this.moved(second)) / 60;
    return (minutes < 0 ? "-" : "+") + [Math.floor(Math.abs(minutes) / 60), Math.abs(minutes) % 60].map(pad).join(":");
  }

  // Return all seconds at which the clock shows a time: two while it is set back, none while it is set forward.
  find(date, inDay) {
    const shownS = (Date.parse(date + "T00:00:00Z") - this.day) / 1000 + inDay - this.startS;
    const moves = [this.moved(-Infinity), ...this.changes.map(([at]) => this.moved(at))];
    return moves.map((movedS) => shownS - movedS).filter((second, place) => this.moved(second) === moves[place]);
  }

  // Return a time for reading, "7 h 05 min 09 s" in French.
  show(second, digits = 0) {
    if (!this.hasClock) return String(round(second, digits));
    const { date, inDay } = this.place(second, digits);
    return this.spansMidnight ? `${date} ${formatClock(inDay, digits)}` : formatClock(inDay, digits);
  }

  // Return the date and the second of the day.
  place(second, digits) {
    const whole = round(this.startS + second + this.moved(second), digits);
    const days = Math.floor(whole / DAY_S);
    return { date: new Date(this.day + days * DAY_S * 1000).toISOString().slice(0, 10), inDay: whole - days * DAY_S };
  }

  // Return seconds from the first sample, or NaN if the time is outside the recording or ambiguous.
  read(text) {
    return this.parse(text).second ?? NaN;
  }

  // Return {second} or {fault}: "unreadable", "outside" the recording, or "ambiguous" without a date.
  parse(text) {
    const shown = text.trim();
    if (!this.hasClock) return /^[0-9]+([.,][0-9]+)?$/.test(shown) ? this.pick([Number(shown.replace(",", "."))]) : { fault: "unreadable" };
    const [, date, hour, offset] = /^(?:(\d{4}-\d{2}-\d{2})[ T])?(.*?)([+-]\d{2}:\d{2})?$/.exec(shown);
    const inDay = readClock(hour.trim());
    if (Number.isNaN(inDay)) return { fault: "unreadable" };
    const days = date ? [date] : [0, 1, 2].map((day) => new Date(this.day + day * DAY_S * 1000).toISOString().slice(0, 10));
    const readings = days.map((day) => this.find(day, inDay));
    if (offset) return this.pick(readings.flat().filter((second) => this.offset(second) === offset));
    const isTwice = readings.some((found) => found.length > 1 && this.pick(found).fault !== "outside");
    return isTwice ? { fault: "ambiguous" } : this.pick(readings.flat());
  }

  pick(seconds) {
    const places = seconds.map((second) => this.check(second)).filter((place) => !Number.isNaN(place));
    if (!places.length) return { fault: "outside" };
    return places[1] < this.durationS ? { fault: "ambiguous" } : { second: places[0] };
  }

  // Format typed times, separated by ";", as they were parsed.
  normalise(text) {
    if (!this.hasClock) return text;
    return text.split(";").map((part) => (Number.isNaN(this.read(part)) ? part.trim() : this.format(this.read(part)))).join("; ");
  }

  check(second) {
    return second >= -0.01 && second <= this.durationS + 0.01 ? Math.min(Math.max(second, 0), this.durationS) : NaN;
  }

  // Round to a step on the clock, within the recording.
  snap(second, stepS) {
    const round = Math.round((this.startS + second) / stepS) * stepS - this.startS;
    return Math.min(Math.max(round, 0), this.durationS);
  }

  // Return round times of a view for an axis of this width: [second, text].
  marks(fromS, toS, widthPx) {
    const steps = [0.01, 0.05, 0.1, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 14400, 43200, 86400];
    const fits = (candidate) => (toS - fromS) / candidate <= Math.max(2, Math.floor(widthPx / (candidate < 60 ? SECONDS_PX : MARK_PX)));
    const step = steps.find(fits) || 86400;
    const first = Math.ceil((fromS + this.startS) / step) * step - this.startS;
    const marks = [];
    for (let at = first; at <= toS; at += step) marks.push([at, this.mark(at, step)]);
    return marks;
  }

  // A mark at midnight shows the date if the recording has several.
  mark(second, step) {
    if (!this.hasClock) return this.format(second);
    const { date, inDay } = this.place(second, 2);
    if (this.spansMidnight && inDay === 0) return date;
    return formatClock(inDay, step >= 60 ? null : step >= 1 ? 0 : step < 0.1 ? 2 : 1);
  }
}

function round(second, digits) {
  return Math.round(second * 10 ** digits) / 10 ** digits;
}
