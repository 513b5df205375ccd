// The day of an analysis: connects clock, bands, view, curve and handles, and handles events.

import { $, fill, say } from "../say.js";
import { Bands } from "./bands.js";
import { Clock } from "./clock.js";
import { Curve } from "./curve.js";
import { Handles } from "./handles.js";
import { listenToMoves, listenToView } from "./gestures.js";
import { Pen } from "./pen.js";
import { listenToForm } from "./form.js";
import { Tasks } from "./tasks.js";
import { View } from "./view.js";

const REST_MS = 60;

export class Day {
  constructor(box, form) {
    this.box = box;
    this.words = JSON.parse(form.dataset.words);
    const { start, duration, dated, changes, curve } = box.dataset;
    this.clock = new Clock(start, Number(duration), Boolean(dated), changes);
    this.bands = new Bands(form, this.clock, this.words);
    this.view = new View(Number(duration), () => this.moved());
    const minutes = JSON.parse(box.dataset.minutes);
    this.curve = new Curve($("curve"), curve, this.clock, this.view, minutes);
    this.handles = new Handles(this.bands, this.curve, this.view, (isDone) => this.changed(isDone));
    this.pen = new Pen(this);
    this.candidates = [...document.querySelectorAll(".choices [data-look]")].map(({ dataset }) => ({
      kind: "candidate", name: dataset.name, startS: this.clock.read(dataset.from), endS: this.clock.read(dataset.to),
    }));
    this.tasks = new Tasks($("tasks-now"), this.bands);
    this.steps = [];
  }

  async open() {
    this.box.hidden = false;
    this.listen();
    await this.curve.load();
    this.changed(true);
    new ResizeObserver(() => this.draw()).observe($("curve"));
  }

  // After a move, draw available data at once, and fetch the rest when the view stops moving.
  moved() {
    const began = performance.now();
    requestAnimationFrame(() => {
      this.draw();
      this.steps.push(performance.now() - began);
    });
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.reload(), REST_MS);
  }

  async reload() {
    try {
      if (await this.curve.load()) this.draw();
    } catch {
      $("day-failed").hidden = false;
    }
  }

  // The flags of the moments that the page lists now, and of the marks; those in a closed list have none.
  flags() {
    const shown = [...document.querySelectorAll("[data-mark]")].filter((part) => !part.closest("details:not([open])"));
    const moments = shown.map(({ dataset }) => ({ text: dataset.mark, atS: this.clock.read(dataset.at) }));
    const marks = this.bands.periods().filter(({ kind }) => kind === "mark");
    return [...moments, ...marks.map(({ name, startS }) => ({ text: name, atS: startS }))];
  }

  draw() {
    this.curve.draw([...this.candidates, ...this.bands.list()], this.bands.chosen, this.flags());
    this.handles.draw();
    const { fromS, toS, durationS } = this.view;
    $("part").style.setProperty("margin-left", `${(100 * fromS) / durationS}%`);
    $("part").style.setProperty("width", `${(100 * (toS - fromS)) / durationS}%`);
    const digits = this.view.spanS < 10 ? 2 : 0;
    $("view").textContent = fill($("view").dataset.text, { start: this.clock.show(fromS, digits), end: this.clock.show(toS, digits) });
  }

  // Handle a changed band: by mouse, key or typing.
  changed(isDone) {
    this.draw();
    clearTimeout(this.scoring);
    if (!isDone) return (this.scoring = setTimeout(() => this.measure(), REST_MS));
    this.bands.remember();
    this.bands.name();
    this.times.checkAll();
    this.measure();
    this.unsent.keep();
    this.count();
  }

  // Handle fields that undo has restored.
  restored() {
    this.bands.chosen = null;
    this.bands.name();
    this.times.checkAll();
    this.draw();
    this.measure();
    this.unsent.keep();
    this.count();
  }

  // Show the number of changes in the draft.
  count() {
    const { dataset } = $("draft").parentElement;
    const n = this.bands.countChanges(this.unsent.asServed);
    dataset.changes = n;
    $("draft").textContent = n === 0 ? dataset.none : n === 1 ? dataset.one : fill(dataset.many, { n });
  }

  // Update the stillness of each window and the time of each task, also during a drag.
  measure() {
    for (const band of this.bands.windows()) this.score(band);
    this.tasks.draw();
    this.block();
  }

  // Disable the button while the server would refuse the form.
  block() {
    const windows = this.bands.windows().map(({ row }) => row);
    const isBad = windows.some((row) => row.dataset.why) || !this.times.isFine;
    [$("again").disabled, $("blocked").hidden] = [isBad, !isBad];
  }

  async score({ row, startS, endS }) {
    const place = row.querySelector("[data-stillness]");
    const ticket = (row.ticket = (row.ticket || 0) + 1);
    const isTyped = [...row.querySelectorAll("input")].some((field) => field.value.trim());
    let shown = "", why = isTyped && !(endS > startS) ? "short" : "";
    if (endS > startS) {
      const query = new URLSearchParams({ start_s: startS, end_s: endS });
      const answer = await fetch(`${this.box.dataset.stillness}?${query}`).catch(() => null); // offline: show no stillness
      const { score, why: refused } = answer?.ok ? await answer.json() : {};
      if (answer?.ok) shown = this.formatStillness(score, refused);
      why = isTyped ? refused || "" : "";
    }
    if (ticket !== row.ticket) return; // a newer request is in progress
    place.textContent = shown;
    row.dataset.why = why;
    this.block();
  }

  formatStillness(score, why) {
    if (why) return fill(this.words.unusable, { why: this.words.why[why] });
    if (score === null) return this.words.none;
    const shown = score.toLocaleString(document.documentElement.lang, { minimumFractionDigits: 2, maximumFractionDigits: 2 });
    const judged = score >= 0.5 ? this.words.good : score >= 0.2 ? this.words.fair : this.words.bad;
    return `${fill(this.words.stillness, { score: shown })}, ${judged}`;
  }

  choose(row) {
    this.bands.chosen = row;
    const band = this.bands.find(row);
    if (band) this.view.show(band.startS, band.endS);
    this.draw();
  }

  chooseAt(second) {
    const band = this.bands.list().findLast(({ startS, endS }) => startS <= second && second <= endS);
    if (band) this.choose(band.row);
  }

  listen() {
    listenToView(this.view);
    listenToMoves(this.curve, (second) => this.chooseAt(second), this.pen);
    $("highest")?.addEventListener("toggle", () => this.draw());
    listenToForm(this);
    for (const query of ["(prefers-color-scheme: dark)", "print"]) window.matchMedia(query).addEventListener("change", () => this.draw());
  }
}

async function begin() {
  const [box, form] = [$("day"), $("correction")];
  if (!box || !form) return;
  for (const part of document.querySelectorAll("[data-script]")) part.hidden = false;
  try {
    const day = new Day(box, form);
    window.acromionDay = day; // for measuring
    await day.open();
  } catch (error) {
    console.info(error);
    box.hidden = true;
    $("day-failed").hidden = false;
  }
}

begin();
