// The two ends of the selected band as sliders: dragged, or moved with the arrow keys (1 s; with Shift 1
// min).

import { $, fill } from "../say.js";

const STEPS_S = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1, PageUp: 60, PageDown: -60 };
const MINUTE_S = 60;
const SHORTEST_S = 0.1;

export class Handles {
  constructor(bands, curve, view, onMove) {
    Object.assign(this, { bands, curve, view, onMove });
    for (const end of ["start", "end"]) {
      const handle = $("handle-" + end);
      handle.addEventListener("keydown", (event) => this.press(event, end));
      handle.addEventListener("pointerdown", (event) => this.grab(event, end));
      handle.addEventListener("pointermove", (event) => {
        if (handle.hasPointerCapture(event.pointerId)) this.to(end, this.curve.secondAt(event.clientX), false);
      });
      handle.addEventListener("pointerup", () => this.onMove(true));
    }
  }

  press(event, end) {
    const band = this.bands.find(this.bands.chosen);
    const step = STEPS_S[event.key] * (event.shiftKey ? MINUTE_S : 1);
    if (!band || !step) return;
    event.preventDefault();
    this.to(end, (end === "start" ? band.startS : band.endS) + step, true);
    const moved = this.bands.find(this.bands.chosen);
    this.view.show(moved.startS, moved.endS);
  }

  grab(event, end) {
    event.preventDefault();
    $("handle-" + end).focus();
    $("handle-" + end).setPointerCapture(event.pointerId);
  }

  to(end, second, isDone) {
    const band = this.bands.find(this.bands.chosen);
    if (!band) return;
    const length = this.view.durationS;
    const start = end === "start" ? Math.max(0, Math.min(second, band.endS - SHORTEST_S)) : band.startS;
    const stop = end === "end" ? Math.min(length, Math.max(second, band.startS + SHORTEST_S)) : band.endS;
    this.bands.move(band.row, start, stop);
    this.onMove(isDone);
  }

  draw() {
    const band = this.bands.find(this.bands.chosen);
    for (const [end, second] of [["start", band?.startS], ["end", band?.endS]]) {
      const handle = $("handle-" + end);
      const pixel = band ? this.curve.pixelOf(second) : null;
      handle.hidden = pixel === null;
      if (pixel === null) continue;
      handle.style.left = `${pixel}px`;
      handle.setAttribute("aria-label", fill(handle.dataset.name, { name: band.name }));
      for (const [name, value] of [["min", 0], ["max", Math.round(this.view.durationS)], ["now", Math.round(second)]]) handle.setAttribute("aria-value" + name, value);
      handle.setAttribute("aria-valuetext", this.bands.clock.show(second));
    }
  }
}
