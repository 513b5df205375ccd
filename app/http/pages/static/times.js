// Clock times, dates and durations in the language of the page, as app/report/words/numbers.py spells them.
// Fields and addresses keep the machine form, "07:05:09"; day/clock.js reads and writes it.

const language = document.documentElement.lang;
export const isFrench = language.startsWith("fr");
const NARROW = "\u202f";
const NO_BREAK = "\u00a0";
const HOUR_S = 3600;

// "07:05", or "7 h 05" in French. digits: decimals of the seconds; null leaves the seconds out.
export function formatClock(secondOfDay, digits = null) {
  const hour = Math.floor(secondOfDay / HOUR_S);
  const minute = pad(Math.floor((secondOfDay % HOUR_S) / 60));
  const whole = isFrench ? `${hour}${NARROW}h${NARROW}${minute}` : `${pad(hour)}:${minute}`;
  if (digits === null) return whole;
  const second = (secondOfDay % 60).toFixed(digits).padStart(digits ? digits + 3 : 2, "0");
  return isFrench ? `${whole}${NARROW}min${NARROW}${second.replace(".", ",")}${NARROW}s` : `${whole}:${second}`;
}

// "2026-11-26 22:11" for an ISO 8601 time, on its own clock.
export function formatMoment(iso) {
  const [, date, hour, minute] = /^(\d{4}-\d{2}-\d{2})T(\d{2}):(\d{2})/.exec(iso) ?? [];
  return date ? `${date} ${formatClock(hour * HOUR_S + minute * 60)}` : "";
}

// "6 h 48 min", "2 min 59 s", "4.2 s".
export function formatDuration(seconds) {
  const tenths = Math.round(seconds * 10) / 10;
  if (tenths < 10) return `${tenths.toLocaleString(language)}${NARROW}s`;
  const parts = Math.round(seconds) < 600
    ? [[Math.floor(Math.round(seconds) / 60), "min"], [Math.round(seconds) % 60, "s"]]
    : [[Math.floor(Math.round(seconds / 60) / 60), "h"], [Math.round(seconds / 60) % 60, "min"]];
  return parts.filter(([count]) => count).map(([count, unit]) => count + NARROW + unit).join(NO_BREAK);
}

// Time since the start: "1:02:05".
export function formatElapsed(seconds) {
  return `${Math.floor(seconds / HOUR_S)}:${pad(Math.floor((seconds % HOUR_S) / 60))}:${pad(Math.floor(seconds % 60))}`;
}

export function pad(number) {
  return String(number).padStart(2, "0");
}
