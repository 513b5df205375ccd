// The bands that a person can move: calibration windows and periods. Their state is in the form's fields.

import { $, fill } from "../say.js";

export class Bands {
  constructor(form, clock, words) {
    Object.assign(this, { form, clock, words });
    this.past = [];
    this.chosen = null;
    this.last = this.snapshot();
  }

  // Return every band with a start and an end: {row, kind, name, startS, endS}.
  list() {
    return [...this.windows(), ...this.periods()].filter((band) => band.endS > band.startS && band.kind !== "posture");
  }

  windows() {
    const shown = this.kinds();
    const rows = [...this.form.querySelectorAll(".window")];
    for (const row of rows) row.hidden = !shown.includes(row.dataset.window);
    for (const part of this.form.querySelectorAll("[data-of]")) part.hidden = !shown.includes(part.dataset.of);
    if ($("axis")) $("axis").hidden = !shown.includes("axis");
    return rows.filter((row) => !row.hidden).map((row, place) => {
      const [start, end] = row.querySelectorAll("input");
      const read = (field) => this.clock.read(field.value || field.placeholder || "");
      const name = this.words.window + (place ? " " + (place + 1) : "");
      return { row, kind: "calibration", name, startS: read(start), endS: read(end) };
    });
  }

  // Return the kinds of fields for the selected pose; without a pose, the axis.
  kinds() {
    const pose = this.form.elements.pose.value;
    if (pose === "axis") return ["axis"];
    return pose === "two-point" ? ["hanging", "level"] : ["hanging", "repeat"];
  }

  periods() {
    return [...$("periods").rows].map((row) => {
      const field = (name) => row.querySelector(`[name=${name}]`);
      const name = field("label").value || field("kind").selectedOptions[0].text;
      const [startS, endS] = ["start", "end"].map((end) => this.clock.read(field(end).value));
      return { row, kind: field("kind").value, name, startS, endS };
    });
  }

  find(row) {
    return this.list().find((band) => band.row === row);
  }

  move(row, startS, endS) {
    const [start, end] = row.querySelectorAll(".moment");
    start.value = this.clock.format(startS);
    end.value = this.clock.format(endS);
  }

  // Add a row for a repeated pose.
  repeat(start, end) {
    const row = $("repeat").content.firstElementChild.cloneNode(true);
    [row.querySelectorAll("input")[0].value, row.querySelectorAll("input")[1].value] = [start, end];
    $("repeats").append(row);
    return row;
  }

  add(kind, label, start, end) {
    const row = $("period").content.firstElementChild.cloneNode(true);
    for (const [name, value] of Object.entries({ kind, label, start, end })) row.querySelector(`[name=${name}]`).value = value;
    $("periods").append(row);
    return row;
  }

  // Name each button after its row, so that a list of buttons is clear to a screen reader.
  name() {
    for (const { row, name } of [...this.windows(), ...this.periods()]) {
      for (const button of row.querySelectorAll("[data-do]")) {
        button.hidden = false;
        button.setAttribute("aria-label", fill(this.words[button.dataset.do], { name }));
      }
    }
    $("no-periods").hidden = $("periods").rows.length > 0;
  }

  snapshot() {
    const windows = [...this.form.querySelectorAll(".window")].map((row) => [...row.querySelectorAll("input")].map((field) => field.value));
    const rows = [...$("periods").rows].map((row) => ["kind", "label", "start", "end"].map((name) => row.querySelector(`[name=${name}]`).value));
    const { side, subject, pose, held, slips, no_slips: noSlips, axis, time_zone: zone, clock_offset: offset, reason } = this.form.elements;
    const others = Object.entries({ side, subject, pose, held, slips, no_slips: noSlips, axis, time_zone: zone, clock_offset: offset, reason }).map(([name, field]) => [name, field?.value]);
    return JSON.stringify({ ...Object.fromEntries(others), windows, rows });
  }

  // Return how many fields, windows and periods differ from a snapshot; the reason is not a change.
  countChanges(snapshot) {
    const [before, now] = [snapshot, this.snapshot()].map((text) => JSON.parse(text));
    const names = Object.keys(before).filter((name) => !["windows", "rows", "reason"].includes(name));
    const differ = (one = [], other = []) => one.join("|") !== other.join("|");
    const longer = now.windows.length > before.windows.length ? now.windows : before.windows;
    const windows = longer.filter((_, place) => differ(before.windows[place], now.windows[place])).length;
    const kept = now.rows.filter((row) => before.rows.some((other) => !differ(row, other))).length;
    const fields = names.filter((name) => (before[name] ?? "") !== (now[name] ?? "")).length;
    return fields + windows + Math.max(before.rows.length, now.rows.length) - kept;
  }

  // Store the state before the last change for undo.
  remember() {
    const now = this.snapshot();
    if (now !== this.last) this.past.push(this.last);
    this.last = now;
    $("undo").disabled = !this.past.length;
  }

  undo() {
    const before = this.past.pop();
    if (!before) return false;
    this.restore(before);
    this.last = before;
    $("undo").disabled = !this.past.length;
    return true;
  }

  restore(snapshot) {
    const { windows, rows, ...others } = JSON.parse(snapshot);
    for (const [name, value] of Object.entries(others)) if (this.form.elements[name]) this.form.elements[name].value = value;
    $("repeats")?.replaceChildren();
    [...this.form.querySelectorAll(".window")].forEach((row, place) => {
      row.querySelectorAll("input").forEach((field, end) => (field.value = windows[place][end]));
    });
    for (const [start, end] of windows.slice(2)) this.repeat(start, end);
    $("periods").replaceChildren();
    for (const row of rows) this.add(...row);
  }
}
