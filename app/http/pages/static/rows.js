// The list of analyses, polled from the server so that all tabs show the same. Only changed rows are
// replaced, and the focus does not move.

import { $, say } from "./say.js";

const FAST_MS = 1000;
const SLOW_MS = 5000;

let timer = 0;
let asked = 0;
let shown = 0; // requests may overlap: an older response never replaces a newer one

// On a phone, rarely used options are collapsed above the list, unless one of them is set.
const narrow = window.matchMedia("(max-width: 44rem)");

function fold() {
  for (const part of document.querySelectorAll(".folds")) {
    const isSaid = [...part.querySelectorAll("input:not([type=radio], [type=hidden])")].some(({ value }) => value);
    part.open = !narrow.matches || isSaid || Boolean(part.closest("#bar:not(.is-bar)"));
  }
}

narrow.addEventListener("change", fold);
fold();

export async function refresh() {
  clearTimeout(timer);
  const turn = (asked += 1);
  try {
    const answer = await fetch($("rows").dataset.source, { headers: { Accept: "text/html", "X-Unattended": "1" } });
    if (answer.status === 401) return location.reload(); // signed out meanwhile
    if (!answer.ok) throw new Error(String(answer.status));
    const fresh = new DOMParser().parseFromString(await answer.text(), "text/html");
    if (turn > shown) show(fresh);
    shown = Math.max(shown, turn);
    if ($("lost")) $("lost").hidden = true;
  } catch {
    if ($("lost")) $("lost").hidden = false;
  }
  clearTimeout(timer);
  timer = setTimeout(refresh, document.querySelector("#rows [data-active]") ? FAST_MS : SLOW_MS);
}

function show(fresh) {
  const list = $("rows").querySelector(".rows");
  const newList = fresh.querySelector(".rows");
  for (const row of newList.children) {
    const old = $(row.id);
    if (old && old.dataset.state !== row.dataset.state) say(row.dataset.announce);
  }
  if ("reloadAtEnd" in $("rows").dataset && !newList.querySelector("[data-active]")) return location.reload();
  const wanted = [...newList.children].map((row) => place(row));
  for (const row of [...list.children]) if (!wanted.includes(row)) row.remove();
  wanted.forEach((row, index) => list.children[index] !== row && list.insertBefore(row, list.children[index] || null));
  showChips(fresh);
  if ($("count")) $("count").textContent = newList.dataset.count;
  const empty = $("rows").querySelector(".empty");
  list.dataset.number = newList.dataset.number;
  if (list.querySelector(".row")) {
    empty?.remove();
    showTools();
  }
  $("rows").dispatchEvent(new Event("shown"));
  showTitle();
}

// Show the search, groups and tables that an empty list does not need, and shrink the upload area.
function showTools() {
  for (const part of document.querySelectorAll("[data-later]")) part.hidden = false;
  $("bar")?.classList.add("is-bar");
  $("bench")?.classList.add("workbench");
}

// Update the number in each group, and add groups that were empty.
function showChips(fresh) {
  const [now, chips] = [fresh.getElementById("chips-now"), document.querySelector(".chips")];
  if (!now || !chips || chips.innerHTML.trim() === now.innerHTML.trim()) return;
  const place = [...chips.children].indexOf(document.activeElement);
  chips.replaceChildren(document.importNode(now.content, true));
  if (place >= 0) chips.children[Math.min(place, chips.children.length - 1)].focus();
}

// Return the row to show: the existing one if nothing has changed.
function place(fresh) {
  const old = $(fresh.id);
  const copy = document.importNode(fresh, true);
  if (!old) return copy;
  if (old.dataset.version === fresh.dataset.version) return old;
  const key = old.contains(document.activeElement) && document.activeElement.dataset.key;
  old.replaceWith(copy);
  if (key) (copy.querySelector(`[data-key="${key}"]`) || copy.querySelector("a, button"))?.focus();
  return copy;
}

// "(3/12)" in front of the title during uploads on this page and analyses on the server.
const title = document.title;
let own = []; // name of each unfinished upload and the key of its row, "" until it is known
let most = 0;

export function showTitle(uploads = own) {
  own = uploads;
  const rows = [...document.querySelectorAll("#rows [data-active]")];
  const isRow = ({ key, name }) => rows.some((row) => (key ? row.id === key : row.dataset.file === name));
  const open = rows.length + own.filter((upload) => !isRow(upload)).length;
  most = open ? Math.max(most, open) : 0;
  document.title = most ? `(${most - open}/${most}) ${title}` : title;
}

if ($("rows")) timer = setTimeout(refresh, FAST_MS);
document.addEventListener("visibilitychange", () => {
  if (!document.hidden && $("rows")) refresh();
});
