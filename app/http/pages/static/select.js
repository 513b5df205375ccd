// Selecting rows of the list: click, Shift and click, Shift and arrow keys, all on the page, all matches. The
// selection is kept while rows are replaced; the action bar is visible while rows are selected.

import { $, fill } from "./say.js";
import { refresh } from "./rows.js";

const [bar, rows] = [$("acts"), $("rows")];
const chosen = new Set();
let last = null; // id of the last clicked row, from which Shift selects
let isEvery = false;

const countAll = () => Number(rows.querySelector(".rows").dataset.number);
const boxes = () => [...rows.querySelectorAll("input[name=recording]:not([type=hidden])")];

function set(box, isChosen) {
  box.checked = isChosen;
  isChosen ? chosen.add(box.value) : chosen.delete(box.value);
}

function setRange(box, isChosen) {
  const all = boxes();
  const [from, to] = [all.findIndex((one) => one.value === last), all.indexOf(box)];
  const [low, high] = from < 0 ? [to, to] : [Math.min(from, to), Math.max(from, to)];
  for (const one of all.slice(low, high + 1)) set(one, isChosen);
}

function show() {
  const all = boxes();
  for (const box of all) {
    box.checked = isEvery || chosen.has(box.value);
    box.closest("tbody").classList.toggle("is-chosen", box.checked);
  }
  const number = isEvery ? countAll() : chosen.size;
  const isPage = all.length > 0 && all.every((box) => box.checked);
  bar.hidden = !number;
  bar.elements.every.value = isEvery ? "1" : "";
  bar.querySelector(".chosen").textContent = fill(isEvery ? bar.dataset.all : bar.dataset.page, { n: number });
  bar.querySelector("[data-choose=every]").hidden = isEvery || !isPage || countAll() <= all.length;
  bar.querySelector("[data-choose=none]").hidden = false;
  const head = $("pick-all");
  if (head) [head.checked, head.indeterminate] = [isPage, !isPage && number > 0];
}

function clear() {
  chosen.clear();
  isEvery = false;
  last = null;
  show();
}

function listen() {
  rows.addEventListener("click", ({ target, shiftKey }) => {
    if (target.id === "pick-all") for (const box of boxes()) set(box, target.checked);
    else if (target.name !== "recording" || target.type !== "checkbox") return;
    else {
      shiftKey ? setRange(target, target.checked) : set(target, target.checked);
      last = target.value;
    }
    isEvery = false;
    show();
  });
  rows.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    const all = boxes();
    const place = all.indexOf(event.target);
    if (!step || place < 0) return;
    event.preventDefault();
    const next = all[place + step];
    if (!next) return;
    if (event.shiftKey) {
      set(event.target, true);
      set(next, true);
      last = next.value;
      isEvery = false;
      show();
    }
    next.focus();
  });
  document.addEventListener("keydown", (event) => event.key === "Escape" && !bar.hidden && clear());
  bar.addEventListener("click", ({ target }) => {
    if (target.dataset.choose === "none") clear();
    if (target.dataset.choose !== "every") return;
    isEvery = true;
    show();
  });
  rows.addEventListener("shown", show);
  document.addEventListener("submit", act);
  document.addEventListener("click", (event) => {
    if (!event.target.matches?.("#done .acted-back")) return;
    event.preventDefault();
    $("done").replaceChildren();
  });
}

// Run an action and show the result in the list. The browser handles downloads and refusals.
async function act(event) {
  const { target, submitter } = event;
  const address = submitter?.getAttribute("formaction") || target.getAttribute("action");
  if (!address.includes("/library/acts/") || submitter?.hasAttribute("data-download")) return;
  event.preventDefault();
  const answer = await fetch(address, { method: "POST", body: new URLSearchParams(new FormData(target)) });
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  $("done").replaceChildren(page.querySelector("#acted") || page.querySelector("main"));
  if (answer.ok) clear();
  await refresh();
}

if (bar) {
  listen();
  show();
}
