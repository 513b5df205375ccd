// Unsent changes in a form: the browser keeps them until they are sent, discarded or two weeks old. Each
// account has separate entries, so that no other person who signs in here sees them; signing out deletes them
// all (Clear-Site-Data).

import { fill } from "./say.js";
import { formatMoment } from "./times.js";

const KEY = "acromion.unsent";
const LONGEST_MS = 14 * 24 * 3600 * 1000;

export class Unsent {
  // serialize() returns the content of the form as text; restore(text) writes it back.
  constructor(form, serialize, restore) {
    Object.assign(this, { form, serialize, restore });
    this.name = `${document.documentElement.dataset.account} ${form.dataset.keep}`;
    this.note = form.querySelector("[data-unsent]");
    this.asServed = serialize();
    this.isKept = true;
    this.show();
    form.addEventListener("input", () => this.keep());
    form.addEventListener("sent", () => this.forget());
    this.note.querySelector("button").addEventListener("click", () => this.discard());
    window.addEventListener("beforeunload", (event) => this.isKept || event.preventDefault());
  }

  show() {
    const entry = readEntries()[this.name];
    if (!entry || entry.text === this.asServed) return;
    try {
      this.restore(entry.text);
    } catch {
      this.restore(this.asServed); // written by an earlier release
      return this.forget();
    }
    const when = formatMoment(toLocalIso(entry.at));
    this.note.querySelector("span").textContent = fill(this.note.dataset.text, { when });
    this.note.hidden = false;
    const folded = this.form.closest("details");
    if (folded) folded.open = true;
  }

  get isChanged() {
    return this.serialize() !== this.asServed;
  }

  keep() {
    if (!this.isChanged) return this.forget();
    const text = this.serialize();
    this.isKept = writeEntries({ ...readEntries(), [this.name]: { at: Date.now(), text } });
  }

  forget() {
    const { [this.name]: gone, ...others } = readEntries();
    if (gone) writeEntries(others);
    [this.note.hidden, this.isKept] = [true, true];
  }

  discard() {
    this.restore(this.asServed);
    this.forget();
    this.form.dispatchEvent(new Event("change"));
  }
}

// Return a time on the clock of this computer, without its zone.
function toLocalIso(atMs) {
  const offsetMs = new Date(atMs).getTimezoneOffset() * 60 * 1000;
  return new Date(atMs - offsetMs).toISOString();
}

function readEntries() {
  try {
    const all = Object.entries(JSON.parse(localStorage.getItem(KEY)) || {});
    return Object.fromEntries(all.filter(([, { at }]) => Date.now() - at < LONGEST_MS));
  } catch {
    return {};
  }
}

// Return false if the browser stores nothing; it then asks before leaving the page.
function writeEntries(entries) {
  try {
    localStorage.setItem(KEY, JSON.stringify(entries));
    return true;
  } catch {
    return false;
  }
}
