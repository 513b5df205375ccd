// Several curves that pan and zoom together: both arms, two visits, a sensor and its reference.

import { $, fill } from "../say.js";
import { Clock } from "./clock.js";
import { Curve } from "./curve.js";
import { listenToMoves, listenToView } from "./gestures.js";
import { View } from "./view.js";

const REST_MS = 60;

// The shared view, shifted for a recording that starts byS seconds after the first.
class ShiftedView {
  constructor(view, byS) {
    Object.assign(this, { view, byS });
  }

  get fromS() {
    return this.view.fromS - this.byS;
  }

  get toS() {
    return this.view.toS - this.byS;
  }

  get spanS() {
    return this.view.spanS;
  }

  set(fromS, toS) {
    this.view.set(fromS + this.byS, toS + this.byS);
  }

  zoom(factor, aboutS) {
    this.view.zoom(factor, aboutS === undefined ? undefined : aboutS + this.byS);
  }

  shift(part) {
    this.view.shift(part);
  }

  whole() {
    this.view.whole();
  }
}

class Curves {
  constructor(box) {
    this.places = [...box.querySelectorAll(".curve")];
    const ends = this.places.map(({ dataset }) => Number(dataset.shift) + Number(dataset.duration));
    this.isOneDay = new Set(this.places.map(({ dataset }) => dataset.start.slice(0, 10))).size === 1;
    this.view = new View(Math.max(...ends), () => this.moved());
    this.curves = this.places.map((place) => this.make(place));
    this.steps = [];
  }

  make(place) {
    const { curve, beside, start, duration, shift, dated, changes, minutes } = place.dataset;
    const clock = new Clock(start, Number(duration), Boolean(dated) && this.isOneDay, changes);
    return new Curve(place, curve, clock, new ShiftedView(this.view, Number(shift)), JSON.parse(minutes), beside);
  }

  async open() {
    listenToView(this.view);
    for (const curve of this.curves) listenToMoves(curve);
    for (const query of ["(prefers-color-scheme: dark)", "print"]) window.matchMedia(query).addEventListener("change", () => this.draw());
    await this.load();
    this.draw();
    const observer = new ResizeObserver(() => this.draw());
    for (const place of this.places) observer.observe(place);
  }

  load() {
    return Promise.all(this.curves.map((curve) => curve.load()));
  }

  // After a move, draw available data at once, and fetch the rest when the view stops moving.
  moved() {
    const began = performance.now();
    requestAnimationFrame(() => {
      this.draw();
      this.steps.push(performance.now() - began);
    });
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.load().then(() => this.draw()).catch(fail), REST_MS);
  }

  // The curves share the time axis of the earliest recording, below the last of them.
  draw() {
    const { clock, view } = this.curves.find((curve) => curve.view.byS === 0);
    const marks = clock.marks(view.fromS, view.toS, this.curves[0].widthPx());
    for (const curve of this.curves) {
      const isLast = curve === this.curves.at(-1);
      curve.draw([], null, [], marks.map(([at, text]) => [at - curve.view.byS, isLast ? text : ""]));
    }
    const digits = view.spanS < 10 ? 2 : 0;
    $("view").textContent = fill($("view").dataset.text, { start: clock.show(view.fromS, digits), end: clock.show(view.toS, digits) });
  }
}

function fail() {
  $("curves-failed").hidden = false;
}

const box = $("curves");
if (box) {
  box.hidden = false;
  const curves = new Curves(box);
  window.acromionCurves = curves; // for measuring
  curves.open().catch((error) => {
    console.info(error);
    box.hidden = true;
    fail();
  });
}
