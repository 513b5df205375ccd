// Unsent changes in a form: the server keeps them as a draft of this person while they are typed, until they are
// sent, discarded or two weeks old. A reload, another tab or another computer shows them again.

import { fill } from "./say.js";
import { formatMoment } from "./times.js";

const PAUSE_MS = 400;

export class Unsent {
  // serialize() returns the content of the form as text; restore(text) writes it back.
  constructor(form, serialize, restore) {
    Object.assign(this, { form, serialize, restore });
    this.address = `${form.action.split("/analyses/")[0]}/drafts/${form.dataset.keep.replace(":", "/")}`;
    this.note = form.querySelector("[data-unsent]");
    this.asServed = this.saved = serialize();
    this.isKept = true;
    this.shown = this.show();
    form.addEventListener("input", () => this.keep());
    form.addEventListener("sent", () => this.forget());
    form.addEventListener("refused", () => this.offerNewer());
    this.note.querySelector("button").addEventListener("click", () => this.discard());
    window.addEventListener("pagehide", () => this.save(true));
    document.addEventListener("visibilitychange", () => (document.hidden ? this.save(true) : this.show()));
    window.addEventListener("beforeunload", (event) => this.isKept || event.preventDefault());
  }

  async show() {
    const answer = await fetch(this.address).catch(() => null);
    const draft = answer?.status === 200 ? await answer.json() : null;
    const isOwn = this.serialize() !== this.saved; // typed here since the last draft
    if (!draft || draft.text === this.serialize() || isOwn) return;
    try {
      this.restore(adapt(draft.text, this.asServed));
    } catch {
      this.restore(this.asServed); // written by an earlier release
      return this.send("DELETE");
    }
    this.saved = draft.text;
    const when = formatMoment(toLocalIso(Date.parse(draft.at)));
    this.note.querySelector("span").textContent = fill(this.note.dataset.text, { when });
    this.note.hidden = false;
    const folded = this.form.closest("details");
    if (folded) folded.open = true;
    this.form.dispatchEvent(new Event("change"));
  }

  get isChanged() {
    return this.serialize() !== this.asServed;
  }

  keep() {
    if (!this.isChanged) this.note.hidden = true;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.save(), PAUSE_MS);
  }

  // Save the form unless it is saved; one request at a time: an older text never replaces a newer one.
  async save(isLeaving = false) {
    clearTimeout(this.timer);
    const text = this.serialize();
    if (text === this.saved || (this.isSaving && !isLeaving)) return;
    this.isSaving = true;
    const isSaved = text === this.asServed ? await this.send("DELETE") : await this.send("PUT", text);
    this.isSaving = false;
    this.isKept = isSaved;
    this.form.toggleAttribute("data-unsaved", !isSaved);
    if (isSaved) this.saved = text;
    if (this.serialize() !== text || !isSaved) this.timer = setTimeout(() => this.save(), isSaved ? 0 : 5 * PAUSE_MS);
  }

  // Return false if the server keeps nothing; the browser then asks before the page is left.
  async send(method, body) {
    const sent = fetch(this.address, { method, body, keepalive: true, headers: { "Content-Type": "text/plain" } });
    return sent.then((answer) => answer.ok, () => false);
  }

  forget() {
    clearTimeout(this.timer);
    [this.note.hidden, this.isKept, this.saved] = [true, true, this.serialize()];
    this.send("DELETE");
  }

  // The report has a newer version: keep what was typed as a draft of that one, and open it.
  offerNewer() {
    const link = this.form.querySelector("[data-newer]");
    if (!link) return;
    link.textContent = link.dataset.carry;
    link.addEventListener("click", async (event) => {
      event.preventDefault();
      const [old, text] = [this.address, this.serialize()];
      this.address = old.replace(/an_\w+$/, link.dataset.newer);
      const isMoved = this.address !== old;
      const body = isMoved ? JSON.stringify({ ...JSON.parse(text), base: JSON.parse(this.asServed) }) : text;
      this.isKept = await this.send("PUT", body);
      this.saved = text;
      location.assign(link.href);
    });
  }

  discard() {
    this.restore(this.asServed);
    this.forget();
    this.form.dispatchEvent(new Event("change"));
  }
}

// Of a draft that was typed on an older version (base), take what was changed there and leave the rest as it is now.
function adapt(text, served) {
  const { base, ...typed } = JSON.parse(text);
  if (!base) return text;
  const now = JSON.parse(served);
  const has = (rows, row) => rows.some((other) => isSame(other, row));
  for (const [name, value] of Object.entries(typed)) {
    if (isSame(value, base[name])) typed[name] = now[name];
    else if (name === "rows") {
      const kept = now.rows.filter((row) => has(value, row) || !has(base.rows, row));
      typed.rows = [...kept, ...value.filter((row) => !has(base.rows, row) && !has(kept, row))];
    }
  }
  return JSON.stringify(typed);
}

function isSame(one, other) {
  return JSON.stringify(one) === JSON.stringify(other);
}

// Return a time on the clock of this computer, without its zone.
function toLocalIso(atMs) {
  const offsetMs = new Date(atMs).getTimezoneOffset() * 60 * 1000;
  return new Date(atMs - offsetMs).toISOString();
}
