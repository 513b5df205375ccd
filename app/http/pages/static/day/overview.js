// The whole day as a thin strip, with a frame around the visible part; a click or drag moves the view.

import { ink } from "./curve.js";

const HEIGHT = 40;
const TOP_DEG = 180;

export class Overview {
  // minutes: those of the report; without them, the lowest and highest samples.
  constructor(place, address, view, minutes) {
    Object.assign(this, { place, address, view, minutes });
    this.canvas = document.createElement("canvas");
    place.append(this.canvas);
    place.addEventListener("pointerdown", (event) => this.follow(event));
    place.addEventListener("pointermove", (event) => event.buttons && this.follow(event));
  }

  async load() {
    if (this.minutes.length) return this.draw();
    const query = new URLSearchParams({ from_s: 0, to_s: this.view.durationS, points: 800 });
    const answer = await fetch(`${this.address}?${query}`);
    if (!answer.ok) throw new Error(String(answer.status));
    this.stretches = (await answer.json()).stretches;
    this.draw();
  }

  follow(event) {
    const box = this.place.getBoundingClientRect();
    const middle = ((event.clientX - box.left) / box.width) * this.view.durationS;
    this.view.set(middle - this.view.spanS / 2, middle + this.view.spanS / 2);
  }

  draw() {
    const width = this.place.clientWidth, scale = window.devicePixelRatio || 1;
    Object.assign(this.canvas, { width: width * scale, height: HEIGHT * scale });
    const pen = this.canvas.getContext("2d");
    pen.scale(scale, scale);
    const xOf = (second) => (second / this.view.durationS) * width;
    const yOf = (degrees) => HEIGHT * (1 - degrees / TOP_DEG);
    for (const [start, end, low, middle, high] of this.minutes.flat()) {
      const wide = Math.max(1, xOf(end - start));
      pen.fillStyle = ink("--minutes");
      pen.fillRect(xOf(start), yOf(high), wide, Math.max(1, yOf(low) - yOf(high)));
      pen.fillStyle = ink("--median");
      pen.fillRect(xOf(start), yOf(middle) - 0.5, wide, 1);
    }
    pen.fillStyle = ink("--accent");
    for (const { start_s: start, step_s: step, low, high } of this.stretches || []) {
      high.forEach((value, place) => {
        if (value === null) return;
        pen.fillRect(xOf(start + place * step), yOf(value), Math.max(1, xOf(step)), Math.max(1, yOf(low[place]) - yOf(value)));
      });
    }
    pen.strokeStyle = ink("--ink");
    pen.lineWidth = 2;
    pen.strokeRect(xOf(this.view.fromS) + 1, 1, Math.max(4, xOf(this.view.spanS) - 2), HEIGHT - 2);
  }
}
