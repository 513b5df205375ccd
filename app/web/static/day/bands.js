// The stretches that a person can move: calibration windows and periods. The form's fields are the one truth.

import { $, fill } from "../say.js";

export class Bands {
  constructor(form, clock, words) {
    Object.assign(this, { form, clock, words });
    this.past = [];
    this.chosen = null;
    this.last = this.snapshot();
  }

  // Every band that has a start and an end: {row, kind, name, startS, endS}.
  list() {
    return [...this.windows(), ...this.periods()].filter((band) => band.endS > band.startS);
  }

  windows() {
    const needed = this.form.elements.pose.value === "two-point" ? 2 : 1;
    const rows = [...this.form.querySelectorAll(".window")];
    rows.forEach((row, place) => (row.hidden = place >= needed));
    return rows.slice(0, needed).map((row, place) => {
      const [start, end] = row.querySelectorAll("input");
      const read = (field) => this.clock.read(field.value || field.placeholder || "");
      const name = this.words.window + (needed > 1 ? " " + (place + 1) : "");
      return { row, kind: "calibration", name, startS: read(start), endS: read(end) };
    });
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
    start.value = this.clock.tell(startS);
    end.value = this.clock.tell(endS);
  }

  add(kind, label, start, end) {
    const row = $("period").content.firstElementChild.cloneNode(true);
    for (const [name, value] of Object.entries({ kind, label, start, end })) row.querySelector(`[name=${name}]`).value = value;
    $("periods").append(row);
    return row;
  }

  // Buttons are named after what they act on, so that a list of buttons makes sense.
  name() {
    for (const { row, name } of this.periods()) {
      for (const button of row.querySelectorAll("[data-do]")) {
        button.hidden = false;
        button.setAttribute("aria-label", fill(this.words[button.dataset.do], { name }));
      }
    }
    for (const field of this.form.querySelectorAll(".moment")) {
      field.setAttribute("aria-invalid", Boolean(field.value.trim()) && Number.isNaN(this.clock.read(field.value)));
    }
    $("no-periods").hidden = $("periods").rows.length > 0;
  }

  snapshot() {
    const windows = [...this.form.querySelectorAll(".window input")].map((field) => field.value);
    const rows = [...$("periods").rows].map((row) => ["kind", "label", "start", "end"].map((name) => row.querySelector(`[name=${name}]`).value));
    return JSON.stringify({ pose: this.form.elements.pose.value, windows, rows });
  }

  // Remember how it was before the change that has just been made.
  remember() {
    const now = this.snapshot();
    if (now !== this.last) this.past.push(this.last);
    this.last = now;
    $("undo").disabled = !this.past.length;
  }

  undo() {
    const before = this.past.pop();
    if (!before) return false;
    const { pose, windows, rows } = JSON.parse(before);
    this.form.elements.pose.value = pose;
    this.form.querySelectorAll(".window input").forEach((field, place) => (field.value = windows[place]));
    $("periods").replaceChildren();
    for (const row of rows) this.add(...row);
    this.last = before;
    $("undo").disabled = !this.past.length;
    return true;
  }
}
