// The page of a study: its squares follow the analyses; a list of participants is sent, and what became of it
// is told.

import { $, fill } from "./say.js";

const LOOK_MS = 3000;
const KEPT = "acromion-participants";
const form = $("participants");
const told = $("list-told");

function tell(text) {
  told.textContent = text;
  told.hidden = !text;
}

async function send(file) {
  const answer = await fetch(form.dataset.address, { method: "POST", body: file }).catch(() => null);
  const found = answer ? await answer.json() : {};
  if (!answer?.ok) return tell([found.title, found.detail, found.fix].filter(Boolean).join(" "));
  const { done, unknown } = form.dataset;
  const rest = found.unknown.length ? " " + fill(unknown, { unknown: found.unknown.join(", ") }) : "";
  sessionStorage.setItem(KEPT, fill(done, { changed: found.changed }) + rest);
  location.reload();
}

// Whoever has the focus keeps it: only what has changed is replaced.
async function look() {
  if (!document.querySelector(".squares .is-queued, .squares .is-running")) return;
  const answer = await fetch(location.href, { headers: { Accept: "text/html" } }).catch(() => null);
  if (answer?.ok) {
    const fresh = new DOMParser().parseFromString(await answer.text(), "text/html").querySelectorAll("[data-live]");
    document.querySelectorAll("[data-live]").forEach((old, index) => {
      if (old.innerHTML !== fresh[index].innerHTML) old.replaceChildren(...fresh[index].childNodes);
    });
  }
  setTimeout(look, LOOK_MS);
}

form.hidden = false;
form.addEventListener("submit", (event) => event.preventDefault());
$("list").addEventListener("change", () => send($("list").files[0]));
tell(sessionStorage.getItem(KEPT) || "");
sessionStorage.removeItem(KEPT);
look();
