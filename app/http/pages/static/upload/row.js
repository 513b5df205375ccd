// One selected file in the list, from waiting to completed. User input is only set as text, never as HTML.

import { $, fill, say } from "../say.js";
import { formatDuration } from "../times.js";
import { formatSize } from "./sizes.js";

const DRAW_MS = 250;
const SURE_MS = 2000; // of sending, before the time left is estimated

export class Row {
  constructor(file, acts) {
    this.file = file;
    this.words = $("upload").dataset;
    this.units = this.words.units.split(" ");
    this.item = $("upload").content.firstElementChild.cloneNode(true);
    this.part(".name").textContent = file.name;
    this.part(".meta").textContent = formatSize(file.size, this.units);
    for (const [name, act] of Object.entries(acts)) this.part(`[data-do=${name}]`).addEventListener("click", act);
    for (const button of this.item.querySelectorAll("[data-do]")) button.setAttribute("aria-label", this.name(button.textContent, file.name));
    $("uploads").append(this.item);
    this.show("waiting");
  }

  part(selector) {
    return this.item.querySelector(selector);
  }

  // Join a name and a text with the colon of the page's language.
  name(subject, text) {
    return `${subject}${this.words.colon} ${text}`;
  }

  show(state) {
    const shown = { waiting: "waiting", uploading: "uploading", lost: "uploading", refused: "refused", duplicate: "duplicate" }[state];
    this.state = state;
    this.item.className = "row is-" + shown;
    this.part(".pill").textContent = this.words[state];
    this.part(".bars").hidden = this.isOver;
    this.part("[data-do=cancel]").hidden = this.isOver;
    this.part("[data-do=retry]").hidden = true;
    this.part("[data-do=remove]").hidden = !this.isOver;
    if (state !== "refused") this.part(".problem").hidden = true;
  }

  get isOver() {
    return this.state === "refused" || this.state === "duplicate";
  }

  // Redraw only a few times a second, because drawing at every progress event would slow the upload.
  progress(bytes) {
    const isDue = bytes >= this.file.size || performance.now() - (this.drawnMs ?? -DRAW_MS) >= DRAW_MS;
    if (!isDue) return;
    this.drawnMs = performance.now();
    this.part("progress").value = this.file.size ? Math.floor((100 * bytes) / this.file.size) : 100;
    const sent = `${formatSize(bytes, this.units)} / ${formatSize(this.file.size, this.units)}`;
    this.part(".bar-word").textContent = [sent, this.estimateLeft(bytes)].filter(Boolean).join(" · ");
  }

  // Estimate the time left from the speed since this page began to send.
  estimateLeft(bytes) {
    this.began ??= { ms: this.drawnMs, bytes };
    const [tookMs, sent] = [this.drawnMs - this.began.ms, bytes - this.began.bytes];
    if (tookMs < SURE_MS || sent <= 0 || bytes >= this.file.size) return "";
    return fill(this.words.left, { duration: formatDuration(Math.ceil(((this.file.size - bytes) / sent) * (tookMs / 1000))) });
  }

  // Show the facts from the first and last bytes: device, rate, start, end.
  showFacts(text) {
    this.part(".understood").textContent = text;
    this.part(".understood").hidden = !text;
  }

  note(text) {
    this.part(".row-note").textContent = text;
    this.part(".row-note").hidden = !text;
  }

  refuse(problem) {
    this.show("refused");
    this.part(".problem").hidden = false;
    for (const name of ["title", "detail", "fix"]) this.part(".problem-" + name).textContent = problem[name] || "";
    this.part(".problem-code").hidden = !problem.code;
    this.part(".problem-code code").textContent = problem.code;
    const help = this.part(".problem-code a");
    help.href = help.dataset.root + problem.code;
    this.part("[data-do=retry]").hidden = !problem.retryable;
    this.isRetryable = Boolean(problem.retryable);
    say(this.name(this.file.name, problem.title));
  }

  loseNetwork() {
    this.refuse({ title: this.words.network, detail: this.words.networkDetail, fix: this.words.networkFix, code: "", retryable: true });
  }

  duplicate(analysis, again) {
    this.show("duplicate");
    const box = this.part(".duplicate");
    box.hidden = false;
    box.querySelector("a").href = analysis.page;
    box.querySelector("a").textContent = fill(this.words.duplicateOpen, { when: analysis.when });
    box.querySelector("button").onclick = again;
    say(this.name(this.file.name, this.words.duplicate));
  }

  remove() {
    this.item.remove();
  }
}
