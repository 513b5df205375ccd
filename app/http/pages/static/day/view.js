// The visible part of the day: zoom and move within the recording.

const CLOSEST_S = 0.2;

export class View {
  constructor(durationS, onChange) {
    Object.assign(this, { durationS, onChange, fromS: 0, toS: durationS });
  }

  set(fromS, toS) {
    const span = Math.min(Math.max(toS - fromS, CLOSEST_S), this.durationS);
    const from = Math.min(Math.max(fromS, 0), this.durationS - span);
    if (from === this.fromS && from + span === this.toS) return;
    [this.fromS, this.toS] = [from, from + span];
    this.onChange();
  }

  get spanS() {
    return this.toS - this.fromS;
  }

  zoom(factor, aboutS = (this.fromS + this.toS) / 2) {
    const from = aboutS - (aboutS - this.fromS) * factor;
    this.set(from, from + this.spanS * factor);
  }

  shift(part) {
    this.set(this.fromS + part * this.spanS, this.toS + part * this.spanS);
  }

  whole() {
    this.set(0, this.durationS);
  }

  // Show a band, with a margin of twice its length on each side.
  show(startS, endS) {
    if (startS >= this.fromS && endS <= this.toS && endS - startS > this.spanS / 20) return;
    const around = Math.max(endS - startS, 2);
    this.set(startS - 2 * around, endS + 2 * around);
  }
}
