// The card after an upload: it asks for person, arm, pose and breaks. It is in the first
// page for the files that were just uploaded, and has its own page for a recording of the list.

import { $, fill, say } from "./say.js";
import { refuse, send } from "./send.js";
import { Clock } from "./day/clock.js";
import { TimeFields } from "./time-field.js";

const LOOK_MS = 1000;
const LIST = "acromion.list"; // the list of participants, for the other cards of this tab
const MOST_CARDS = 6;
const SCALE_PX = 30; // beside the curve, as in finish.py

let isTyped = false; // answers that were not saved

window.addEventListener("beforeunload", (event) => isTyped && event.preventDefault());

class Card {
  // onEnd(address of the report) is called after the answers were saved; "" if the card was skipped.
  constructor(section, onEnd) {
    Object.assign(this, { section, onEnd, form: section.querySelector("form") });
    section.querySelector("[data-skip]").addEventListener("click", (event) => {
      if (!this.onEnd) return; // the browser asks
      event.preventDefault();
      if (isTyped && !confirm(event.target.dataset.skip)) return;
      isTyped = false;
      this.end("");
    });
    if (!this.form) return;
    section.addEventListener("click", (event) => this.act(event.target.closest("button")));
    section.addEventListener("click", ({ target }) => target.matches(".stretch") && this.choose(target.dataset.value));
    this.form.addEventListener("input", (event) => this.type(event));
    this.form.addEventListener("focusout", () => setTimeout(() => this.show()));
    this.form.addEventListener("sent", () => (isTyped = false));
    this.form.addEventListener("change", () => this.show());
    this.form.addEventListener("submit", (event) => this.save(event));
    section.querySelector("[type=file]").addEventListener("change", ({ target }) => this.takeList(target));
    this.open();
    if (readList()) this.askList();
  }

  part(selector) {
    return this.section.querySelector(selector);
  }

  get isOver() {
    return !["queued", "running"].includes(this.section.dataset.state);
  }

  // Show what needs scripts, and follow the analysis until the questions about its day can be asked.
  open() {
    for (const part of this.section.querySelectorAll("[data-script]")) part.hidden = false;
    if (!this.isOver) this.timer = setTimeout(() => this.look(), LOOK_MS);
    const { begin, duration, dated, changes } = this.form.dataset;
    if (duration) this.times = new TimeFields(this.form, new Clock(begin, Number(duration), Boolean(dated), changes), () => this.show());
    this.show();
  }

  async look() {
    const fresh = await fetchCard(this.address()).catch(() => null);
    if (this.isEnded) return;
    if (!fresh) return (this.timer = setTimeout(() => this.look(), LOOK_MS));
    const form = fresh.querySelector("form");
    if (!form || fresh.querySelector(".problem-title, [data-problem]")) return this.replace(fresh);
    this.section.dataset.state = fresh.dataset.state;
    Object.assign(this.form.dataset, form.dataset);
    this.form.elements.analysis.value = form.elements.analysis.value;
    this.part("[data-start]").textContent = fresh.querySelector("[data-start]").textContent;
    this.part("[data-rest]").replaceChildren(...fresh.querySelector("[data-rest]").childNodes);
    if (this.isOver) say(fresh.dataset.announce);
    this.open();
  }

  // The analysis failed: show why.
  replace(fresh) {
    const section = document.importNode(fresh, true);
    this.section.replaceWith(section);
    new Card(section, this.onEnd && ((address) => this.end(address)));
    say(section.dataset.announce);
  }

  address(place = "") {
    const { address, analysis } = this.section.dataset;
    return `${address}${place}${analysis ? `?analysis=${analysis}` : ""}`;
  }

  act(button) {
    if (!button) return;
    const { propose: name, value } = button.dataset;
    if (name) isTyped = true;
    if (name === "subject") this.form.elements.subject.value = value;
    if (name === "side") this.form.elements.side.value = value;
    if (name) this.form.dispatchEvent(new Event("change"));
    if ("another" in button.dataset) this.addRow("break", "label");
    if ("anotherShift" in button.dataset) this.addRow("shift", "shift_start");
  }

  addRow(kind, name) {
    this.part(`[data-${kind}s]`).append(this.part(`[data-${kind}-row]`).content.cloneNode(true));
    [...this.section.querySelectorAll(`[data-${kind}]`)].at(-1).querySelector(`[name=${name}]`).focus();
    this.show();
  }

  choose(value) {
    const { choice, cut } = this.form.elements;
    if (choice) choice.value = value;
    if (cut) cut.value = "lines";
    this.show();
  }

  // Typing in the fields of a cut also chooses this cut.
  type({ target }) {
    isTyped = true;
    const cut = target.closest("[data-cut]")?.dataset.cut;
    if (cut) this.form.elements.cut.value = cut;
    this.show();
  }

  // Mark the chosen stretch and the accepted proposals; nothing is sent while a time cannot be used.
  show() {
    const choice = this.form.elements.choice?.value;
    for (const stretch of this.section.querySelectorAll(".stretch")) stretch.classList.toggle("is-chosen", stretch.dataset.value === choice);
    this.showShifts();
    const other = this.part("[data-other]");
    if (other) other.hidden = choice !== "other";
    for (const button of this.section.querySelectorAll("[data-propose]")) button.hidden = this.form.elements[button.dataset.propose].value === button.dataset.value;
    const open = [...this.section.querySelectorAll("[data-break]")].filter((row) => this.markOpen(row));
    this.part("[type=submit]").disabled = !this.isOver || open.length > 0 || Boolean(this.times && !this.times.isFine);
  }

  // Show the fields of the chosen cut, and each typed shift at its place on the curve.
  showShifts() {
    const cut = this.form.elements.cut?.value;
    if (cut === undefined) return;
    this.part("[data-cut=hours]").hidden = cut !== "hours";
    this.part("[data-cut=lines]").hidden = cut === "hours" || cut === "whole";
    this.part("[name=not_removed]").disabled = cut === "whole";
    for (const name of ["hours_start", "hours_end"]) this.form.elements[name].required = cut === "hours";
    const rows = [...this.section.querySelectorAll("[data-shift]")];
    for (const mark of this.section.querySelectorAll(".stretch")) {
      const [start, end] = [...rows[mark.dataset.value].querySelectorAll("input")].map((field) => this.times.clock.read(field.value));
      mark.classList.toggle("is-chosen", cut === "lines");
      mark.classList.toggle("is-gone", !(end > start) || cut === "whole" || cut === "hours");
      const plot = mark.ownerSVGElement.viewBox.baseVal.width - SCALE_PX;
      if (end > start) mark.setAttribute("x", (start / this.times.clock.durationS) * plot);
      if (end > start) mark.setAttribute("width", Math.max(((end - start) / this.times.clock.durationS) * plot, 3));
    }
  }

  // Return whether a break lacks its start or end; say so once its row is left.
  markOpen(row) {
    const [label, start, end] = ["label", "start", "end"].map((name) => row.querySelector(`[name=${name}]`).value.trim());
    const isOpen = Boolean(label || start || end) && !(start && end);
    row.querySelector("[data-incomplete]").hidden = !isOpen || row.contains(document.activeElement);
    return isOpen;
  }

  async save(event) {
    event.preventDefault();
    const words = { busy: this.form.dataset.busy, lost: this.part("[data-lost]"), refused: this.part("[data-refused]") };
    await send(this.form, this.part("[type=submit]"), words, this.onEnd ? (address) => this.end(address) : undefined);
  }

  end(address) {
    this.isEnded = true;
    clearTimeout(this.timer);
    this.onEnd(address);
  }

  async takeList(field) {
    keepList(await field.files[0].text());
    field.value = "";
    await this.askList();
  }

  async askList() {
    const field = this.part("[type=file]");
    const answer = await fetch(this.address("/proposal"), { method: "POST", body: readList() }).catch(() => null);
    const box = this.part("[data-refused]");
    box.hidden = true;
    if (answer && !answer.ok) return keepList(""), refuse(box, await answer.text());
    const found = answer ? await answer.json() : {};
    for (const [name, value] of Object.entries(found)) if (value) this.propose(name, value, field.dataset);
    this.part("[data-list-told]").textContent = found.subject || found.side ? "" : field.dataset.none;
  }

  propose(name, value, words) {
    const button = Object.assign(document.createElement("button"), { type: "button", className: "button plain small", textContent: fill(words.told, { value: words[value] || value }) });
    Object.assign(button.dataset, { propose: name, value });
    this.part(`[data-proposals=${name}]`).replaceChildren(button);
    this.show();
  }
}

// The cards of the files that were just uploaded, one after the other.
export class Cards {
  constructor(place) {
    Object.assign(this, { place, waiting: [], count: 0, number: 0, isOpen: false });
  }

  // Ask about a recording; many at once are only marked in the list.
  add(address) {
    if (this.count >= MOST_CARDS) return;
    this.waiting.push(address);
    this.count += 1;
    if (!this.isOpen) return this.next();
    this.tell();
  }

  async next() {
    const address = this.waiting.shift();
    this.isOpen = true;
    this.number += 1;
    const fresh = await fetchCard(address).catch(() => null);
    if (!fresh) return this.end("");
    const section = document.importNode(fresh, true);
    this.place.replaceChildren(section);
    this.tell();
    section.scrollIntoView({ block: "nearest" });
    new Card(section, (report) => this.end(report));
  }

  tell() {
    const place = this.place.querySelector("[data-place]");
    if (place && this.count > 1) place.textContent = ` · ${this.number}/${this.count}`;
  }

  end(report) {
    this.place.replaceChildren();
    if (this.waiting.length) return this.next();
    const isSingle = this.count === 1;
    Object.assign(this, { count: 0, number: 0, isOpen: false });
    if (report && isSingle) location.assign(report);
  }
}

async function fetchCard(address) {
  const answer = await fetch(address, { headers: { Accept: "text/html", "X-Unattended": "1" } });
  if (!answer.ok) throw new Error(String(answer.status));
  return new DOMParser().parseFromString(await answer.text(), "text/html").getElementById("finish");
}

function readList() {
  try {
    return sessionStorage.getItem(LIST) || "";
  } catch {
    return "";
  }
}

function keepList(text) {
  try {
    sessionStorage.setItem(LIST, text);
  } catch {
    // private browsing: the list is asked for at each card
  }
}

const own = $("finish");
if (own) new Card(own, null);
