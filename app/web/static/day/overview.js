// The whole day as a thin strip, with a frame around the part in view; a click or a drag moves the view.

import { ink } from "./curve.js";

const HEIGHT = 40;
const TOP_DEG = 180;

export class Overview {
  constructor(place, address, view) {
    Object.assign(this, { place, address, view });
    this.canvas = document.createElement("canvas");
    place.append(this.canvas);
    place.addEventListener("pointerdown", (event) => this.follow(event));
    place.addEventListener("pointermove", (event) => event.buttons && this.follow(event));
  }

  async load() {
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
    pen.fillStyle = ink("--accent");
    for (const { start_s: start, step_s: step, low, high } of this.stretches || []) {
      high.forEach((value, place) => {
        if (value === null) return;
        const top = HEIGHT * (1 - value / TOP_DEG), bottom = HEIGHT * (1 - low[place] / TOP_DEG);
        pen.fillRect(xOf(start + place * step), top, Math.max(1, xOf(step)), Math.max(1, bottom - top));
      });
    }
    pen.strokeStyle = ink("--ink");
    pen.lineWidth = 2;
    pen.strokeRect(xOf(this.view.fromS) + 1, 1, Math.max(4, xOf(this.view.spanS) - 2), HEIGHT - 2);
  }
}
