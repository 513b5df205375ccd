// Fields for times, the same on every page: read as they are typed, marked if they cannot be used, and written
// as they were read when the field is left. Every time in a row (.period, .window, .span) belongs to one range;
// a field with data-moments takes several times, separated by ";".

import { fill } from "./say.js";

const FIELD = ".moment, [data-moments]";
const ROW = ".period, .window, .span";
// "1", "10:", "10h2", "102": a time that is not finished is not marked before the field is left.
const UNFINISHED = /^(?:\d{4}-\d{2}-\d{2}[ T])?(?:\d{1,3}|\d{1,2}\s?[:.,h]\s?\d?|\d{1,2}([:.,])\d{2}\1\d?)$|^\d{4}-[\d-]*$/i;

let count = 0;

// words: the messages, and "from" and "to" of the recording. onCheck is called after every check.
export class TimeFields {
  constructor(form, clock, onCheck = () => {}) {
    Object.assign(this, { form, clock, onCheck, words: JSON.parse(form.dataset.times) });
    this.bounds = { from: clock.format(0), to: clock.format(clock.durationS) };
    form.addEventListener("input", ({ target }) => target.matches(FIELD) && this.check(target));
    form.addEventListener("change", ({ target }) => {
      if (!target.matches(FIELD)) return;
      target.value = clock.normalise(target.value);
      this.check(target, true);
    });
  }

  // Check every row again, for example after undo.
  checkAll() {
    for (const field of this.form.querySelectorAll(FIELD)) this.mark(field, this.find(field));
  }

  get isFine() {
    const faulty = this.form.querySelectorAll(":is(.moment, [data-moments])[aria-invalid=true]");
    return [...faulty].every((field) => field.closest("[hidden]"));
  }

  check(typed, isLeft = false) {
    for (const field of typed.closest(ROW)?.querySelectorAll(".moment") || [typed]) {
      const isUnfinished = field === typed && !isLeft && UNFINISHED.test(field.value.split(";").at(-1).trim());
      const fault = this.find(field);
      this.mark(field, isUnfinished && fault === "unreadable" ? "" : fault);
    }
    this.onCheck();
  }

  // Return why a field cannot be used: a fault of Clock.parse, or "reversed"; "" if it can.
  find(field) {
    const times = field.value.split(";").filter((text) => text.trim()).map((text) => this.clock.parse(text));
    if (!times.length) return "";
    if (times.length > 1 && field.matches(".moment")) return "unreadable";
    const { fault } = times.find((time) => time.fault) || {};
    if (fault) return fault === "unreadable" && !this.clock.hasClock ? "no_seconds" : fault;
    const [{ second }] = times;
    const [start, end] = field.closest(ROW)?.querySelectorAll(".moment") || [];
    return field === end && this.clock.read(start.value || start.placeholder) >= second ? "reversed" : "";
  }

  mark(field, fault) {
    const note = this.getNote(field);
    const text = fault ? fill(this.words[fault], this.bounds) : "";
    if (note.textContent !== text) note.textContent = text;
    note.hidden = !fault;
    field.setAttribute("aria-invalid", Boolean(fault));
  }

  // The message is next to its field, and read with it.
  getNote(field) {
    const known = document.getElementById(field.dataset.note);
    if (known) return known;
    const note = Object.assign(document.createElement("span"), { id: `time-note-${(count += 1)}`, className: "time-note", hidden: true });
    note.setAttribute("role", "status");
    (field.closest("label") || field).after(note);
    field.dataset.note = note.id;
    field.setAttribute("aria-describedby", [note.id, field.getAttribute("aria-describedby")].filter(Boolean).join(" "));
    return note;
  }
}
