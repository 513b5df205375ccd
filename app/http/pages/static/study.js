// The page of a study: ranking and states follow the analyses. A list of participants has a preview with its
// matches and changes, and is applied by a button.

import { $ } from "./say.js";
import { refuse } from "./send.js";

const LOOK_MS = 3000;
const KEPT = "acromion-participants";
const form = $("participants"); // absent if the study has no recordings of people
const result = $("list-told");

let list = null; // the chosen file, until it is applied

function show(lines) {
  result.replaceChildren(...lines.map((line) => Object.assign(document.createElement("p"), { textContent: line })));
  result.hidden = !lines.length;
}

// Return the answer of the server, null after a refusal, which is shown.
async function post(query) {
  const answer = await fetch(form.dataset.address + query, { method: "POST", body: list }).catch(() => null);
  if (answer?.ok) return answer.json();
  if (answer) refuse(result, await answer.text());
  else show([form.dataset.lost]);
  return null;
}

async function preview(file) {
  list = file;
  $("list").value = "";
  const answer = await post("?preview=1");
  if (answer) show(answer.told);
  $("list-acts").hidden = !answer?.changed;
}

async function apply() {
  if (!(await post(""))) return;
  sessionStorage.setItem(KEPT, form.dataset.done);
  isTyped = false; // the list was sent in place of the typed codes
  location.reload();
}

function leave() {
  $("list-acts").hidden = true;
  show([]);
}

// Return whether no previewed list waits to be applied; a reload would lose it.
function isDecided() {
  return !form || $("list-acts").hidden;
}

// Replace only changed parts, so that the focus does not move.
async function poll() {
  if (!document.querySelector('[data-state="queued"], [data-state="running"]')) return;
  const answer = await fetch(location.href, { headers: { Accept: "text/html", "X-Unattended": "1" } }).catch(() => null);
  if (answer?.ok) {
    const fresh = new DOMParser().parseFromString(await answer.text(), "text/html").querySelectorAll("[data-live]");
    const shown = document.querySelectorAll("[data-live]");
    const isOther = fresh.length !== shown.length; // a recording was added or deleted
    if (isOther && !isTyped && isDecided()) return location.reload();
    if (!isOther) shown.forEach((old, index) => {
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
  form.addEventListener("submit", (event) => (event.preventDefault(), apply()));
  form.addEventListener("reset", leave);
  $("list").addEventListener("change", () => preview($("list").files[0]));
  show([sessionStorage.getItem(KEPT)].filter(Boolean));
  sessionStorage.removeItem(KEPT);
}
poll();
