// The page of a study: ranking and states follow the analyses; a list of participants is uploaded, and the
// result is shown.

import { $, fill } from "./say.js";

const LOOK_MS = 3000;
const KEPT = "acromion-participants";
const form = $("participants"); // absent if the study has no recordings of people
const result = $("list-told");

function showResult(text) {
  result.textContent = text;
  result.hidden = !text;
}

async function send(file) {
  $("list").value = "";
  const answer = await fetch(form.dataset.address, { method: "POST", body: file }).catch(() => null);
  if (!answer?.ok) return refuse(answer ? await answer.text() : "");
  const { changed, unknown } = await answer.json();
  const rest = unknown.length ? " " + fill(form.dataset.unknown, { unknown: unknown.join(", ") }) : "";
  sessionStorage.setItem(KEPT, fill(form.dataset.done, { changed }) + rest);
  isTyped = false; // the list was sent in place of the typed codes
  location.reload();
}

// The server responds to a refusal with a page; show its problem here.
function refuse(page) {
  const said = new DOMParser().parseFromString(page, "text/html").querySelector("[data-problem]");
  result.hidden = false;
  result.replaceChildren(...(said ? [...document.importNode(said, true).children] : [form.dataset.lost]));
}

// Replace only changed parts, so that the focus does not move.
async function poll() {
  if (!document.querySelector('[data-state="queued"], [data-state="running"]')) return;
  const answer = await fetch(location.href, { headers: { Accept: "text/html", "X-Unattended": "1" } }).catch(() => null);
  if (answer?.ok) {
    const fresh = new DOMParser().parseFromString(await answer.text(), "text/html").querySelectorAll("[data-live]");
    const shown = document.querySelectorAll("[data-live]");
    if (fresh.length !== shown.length) return location.reload(); // a recording was added or deleted
    shown.forEach((old, index) => {
      if (old.innerHTML !== fresh[index].innerHTML) old.replaceChildren(...fresh[index].childNodes);
      [old.className, old.dataset.state] = [fresh[index].className, fresh[index].dataset.state || ""];
    });
  }
  setTimeout(poll, LOOK_MS);
}

// Ask before codes that were typed and not saved are lost.
let isTyped = false;
const whose = document.querySelector(".whose")?.closest("form");
whose?.addEventListener("input", () => (isTyped = true));
whose?.addEventListener("submit", () => (isTyped = false));
window.addEventListener("beforeunload", (event) => isTyped && event.preventDefault());

if (form) {
  form.hidden = false;
  form.addEventListener("submit", (event) => event.preventDefault());
  $("list").addEventListener("change", () => send($("list").files[0]));
  showResult(sessionStorage.getItem(KEPT) || "");
  sessionStorage.removeItem(KEPT);
}
poll();
