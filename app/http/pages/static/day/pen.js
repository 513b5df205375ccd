// Mark a task, a break or the pose: drag over the curve, or press Enter for the middle of the view.

import { $, fill, say } from "../say.js";

const NEW_PART = 0.1;
const POSE_S = 10;
const STEPS_S = [0.01, 0.1, 1, 5, 10, 30, 60, 300];

export class Pen {
  constructor(day) {
    this.day = day;
    this.row = null;
    for (const choice of document.querySelectorAll("[name=drag]")) choice.addEventListener("change", () => ($("curve").dataset.drag = choice.value));
    $("curve").addEventListener("keydown", (event) => event.key === "Enter" && this.isDown && this.place());
  }

  get kind() {
    return document.querySelector("[name=drag]:checked").value;
  }

  get isDown() {
    return this.kind !== "move";
  }

  // Draw from one time to another while the pointer moves.
  draw(fromS, toS) {
    const { bands, clock } = this.day;
    this.row ||= this.start();
    bands.chosen = this.row;
    bands.move(this.row, ...[fromS, toS].sort((one, other) => one - other).map((second) => clock.snap(second, this.stepS())));
    this.day.changed(false);
  }

  // Return the round step that is at least as long as one pixel.
  stepS() {
    const pixelS = this.day.view.spanS / this.day.curve.widthPx();
    return STEPS_S.find((step) => step >= pixelS) || STEPS_S.at(-1);
  }

  // Add a row of the chosen kind, or use the fields of the pose.
  start() {
    const { bands } = this.day;
    if (this.kind !== "pose") return bands.add(this.isDown ? this.kind : "task", "", "", "");
    const { pose } = bands.form.elements;
    if (pose.value === "axis") pose.value = "n-pose";
    const windows = bands.windows().map(({ row }) => row);
    const isFree = (row) => ![...row.querySelectorAll("input")].some((field) => field.value);
    return windows.find(isFree) || windows.find((row) => row === bands.chosen) || windows[0];
  }

  // The pointer was lifted, or its move was cancelled.
  lift(isDone = true) {
    const { day, row } = this;
    this.row = null;
    if (!row) return;
    if (!isDone) return day.bands.restore(day.bands.last), day.restored();
    day.changed(true);
    day.bands.chosen = row;
    this.tell(row);
  }

  // Add a band in the middle of the view, for the keyboard and for the button below the periods.
  place() {
    const { day } = this, { view, clock, bands } = day;
    const half = this.kind === "pose" ? POSE_S / 2 : Math.max(Math.round((view.spanS * NEW_PART) / 2), 1);
    const middle = Math.round((view.fromS + view.toS) / 2);
    const row = this.start();
    bands.move(row, clock.snap(Math.max(0, middle - half), 0.01), Math.min(view.durationS, middle + half));
    day.choose(row);
    day.changed(true);
    this.tell(row);
  }

  // Announce the new period, and ask for its name if the fields are beside the curve or were used to add it.
  tell(row) {
    say(fill(this.day.words.added, { name: this.day.bands.find(row)?.name }));
    const field = row.querySelector("[name=label]"), drawer = row.closest(".drawer");
    if (getComputedStyle(drawer).position !== "fixed" && !drawer.contains(document.activeElement)) return;
    if (field) field.focus();
    else row.scrollIntoView({ block: "nearest" });
  }
}
