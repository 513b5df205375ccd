// What the page needs beyond HTML: sending files with progress, and asking the server what has become of
// them. Every word comes from the server; every text of a person is set as text, never as markup.
"use strict";

const AT_ONCE = 3;
const FAST_MS = 1000;
const SLOW_MS = 5000;

const $ = (id) => document.getElementById(id);
const waiting = [];
let sending = 0;
let sent = 0;
let asked = 0;
const title = document.title;

// --- sending -------------------------------------------------------------------------------------

function addFiles(files) {
  for (const file of files) queueUpload(file, readWishes());
  sendNext();
}

function readWishes() {
  const form = new FormData($("drop"));
  return { side: form.get("side"), subject: form.get("subject").trim() };
}

function queueUpload(file, wishes) {
  const row = $("upload").content.firstElementChild.cloneNode(true);
  const upload = { file, wishes, row, request: null };
  row.querySelector(".name").textContent = file.name;
  row.querySelector(".meta").textContent = [wishes.subject, formatSize(file.size)].filter(Boolean).join(" · ");
  row.querySelector("[data-do=cancel]").addEventListener("click", () => cancelUpload(upload));
  row.querySelector("[data-do=retry]").addEventListener("click", () => retryUpload(upload));
  row.querySelector("[data-do=remove]").addEventListener("click", () => row.remove());
  $("uploads").append(row);
  enqueue(upload);
}

function enqueue(upload) {
  showState(upload, "uploading", $("upload").dataset.waiting);
  asked += 1;
  waiting.push(upload);
}

function sendNext() {
  while (sending < AT_ONCE && waiting.length) sendFile(waiting.shift());
  showTitle();
}

function sendFile(upload) {
  const words = $("upload").dataset;
  const limit = Number($("drop").dataset.maxBytes);
  if (upload.file.size > limit) {
    const detail = words.tooBigDetail.replace("{size}", formatSize(upload.file.size)).replace("{max}", formatSize(limit));
    sent += 1;
    return refuse(upload, { title: words.tooBig, detail, fix: words.tooBigFix, code: "E-BIG", retryable: false });
  }
  sending += 1;
  const request = new XMLHttpRequest();
  upload.request = request;
  showState(upload, "uploading", words.uploading);
  request.upload.addEventListener("progress", (event) => showProgress(upload, event));
  request.addEventListener("load", () => finish(upload, () => readAnswer(upload, request)));
  request.addEventListener("error", () => finish(upload, () => refuse(upload, nameNetworkLoss())));
  request.addEventListener("abort", () => finish(upload, () => upload.row.remove()));
  request.open("POST", "/api/v1/analyze?" + describeWishes(upload));
  request.setRequestHeader("Content-Type", "application/octet-stream");
  request.send(upload.file);
}

function describeWishes(upload) {
  const query = new URLSearchParams({ file_name: upload.file.name, lang: $("drop").dataset.lang });
  for (const [name, value] of Object.entries(upload.wishes)) if (value) query.set(name, value);
  return query.toString();
}

function finish(upload, then) {
  sending -= 1;
  sent += 1;
  upload.request = null;
  then();
  sendNext();
}

function readAnswer(upload, request) {
  if (request.status < 300) {
    say($("upload").dataset.added.replace("{name}", upload.file.name));
    refresh().finally(() => upload.row.remove());
    return;
  }
  try {
    refuse(upload, JSON.parse(request.responseText));
  } catch {
    refuse(upload, nameNetworkLoss());
  }
}

function nameNetworkLoss() {
  const words = $("upload").dataset;
  return { title: words.network, detail: words.networkDetail, fix: words.networkFix, code: "", retryable: true };
}

function refuse(upload, problem) {
  const row = upload.row;
  showState(upload, "refused", $("upload").dataset.refused);
  row.querySelector(".bars").hidden = true;
  row.querySelector(".problem").hidden = false;
  row.querySelector(".problem-title").textContent = problem.title;
  row.querySelector(".problem-detail").textContent = problem.detail;
  row.querySelector(".problem-fix").textContent = problem.fix;
  row.querySelector(".problem-code").hidden = !problem.code;
  row.querySelector(".problem-code code").textContent = problem.code;
  row.querySelector("[data-do=cancel]").hidden = true;
  row.querySelector("[data-do=retry]").hidden = !problem.retryable;
  row.querySelector("[data-do=remove]").hidden = false;
  say(upload.file.name + ": " + problem.title);
}

function cancelUpload(upload) {
  if (upload.request) return upload.request.abort();
  waiting.splice(waiting.indexOf(upload), 1);
  asked -= 1;
  upload.row.remove();
}

function retryUpload(upload) {
  const row = upload.row;
  row.querySelector(".bars").hidden = false;
  row.querySelector(".problem").hidden = true;
  row.querySelector("[data-do=cancel]").hidden = false;
  row.querySelector("[data-do=retry]").hidden = true;
  row.querySelector("[data-do=remove]").hidden = true;
  enqueue(upload);
  sendNext();
}

function showState(upload, state, word) {
  upload.row.className = "row is-" + state;
  upload.row.querySelector(".pill").textContent = word;
}

function showProgress(upload, event) {
  if (!event.lengthComputable || !event.total) return;
  const percent = Math.floor((100 * event.loaded) / event.total);
  upload.row.querySelector("progress").value = percent;
  upload.row.querySelector(".bar-word").textContent = formatSize(event.loaded) + " / " + formatSize(event.total);
}

function showTitle() {
  const busy = sending + waiting.length;
  if (!busy) sent = asked = 0;
  const words = $("upload").dataset.title;
  document.title = busy ? words.replace("{done}", sent).replace("{all}", asked).replace("{title}", title) : title;
}

function formatSize(bytes) {
  const units = $("upload").dataset.units.split(" ");
  const power = Math.min(3, bytes ? Math.floor(Math.log10(bytes) / 3) : 0);
  const digits = power >= 2 ? 1 : 0;
  const number = (bytes / 1000 ** power).toLocaleString(document.documentElement.lang, {
    minimumFractionDigits: digits,
    maximumFractionDigits: digits,
  });
  return number + "\u00a0" + units[power];
}

// --- what the server says ------------------------------------------------------------------------

let timer = 0;

async function refresh() {
  clearTimeout(timer);
  try {
    const answer = await fetch($("rows").dataset.source, { headers: { Accept: "text/html" } });
    if (!answer.ok) throw new Error(String(answer.status));
    showRows(new DOMParser().parseFromString(await answer.text(), "text/html"));
    if ($("lost")) $("lost").hidden = true;
  } catch {
    if ($("lost")) $("lost").hidden = false;
  }
  timer = setTimeout(refresh, document.querySelector("#rows [data-active]") ? FAST_MS : SLOW_MS);
}

function showRows(fresh) {
  const list = $("rows").querySelector(".rows");
  const newList = fresh.querySelector(".rows");
  announceEnds(newList);
  if ("reloadAtEnd" in $("rows").dataset && !newList.querySelector("[data-active]")) return location.reload();
  for (const row of [...newList.children].reverse()) placeRow(list, row);
  for (const row of [...list.children]) if (!newList.querySelector("#" + row.id) && !row.dataset.kept) row.remove();
  if ($("count")) $("count").textContent = newList.dataset.count;
  const empty = $("rows").querySelector(".empty");
  if (empty && list.children.length) empty.remove();
}

function placeRow(list, fresh) {
  const copy = document.importNode(fresh, true);
  copy.dataset.kept = "yes";
  const old = $(fresh.id);
  if (!old) {
    list.prepend(copy);
  } else if (old.dataset.version !== fresh.dataset.version) {
    const key = old.contains(document.activeElement) && document.activeElement.dataset.key;
    old.replaceWith(copy);
    if (key) (copy.querySelector(`[data-key="${key}"]`) || copy.querySelector("a, button"))?.focus();
  } else {
    old.dataset.kept = "yes";
  }
}

function announceEnds(newList) {
  for (const row of newList.children) {
    const old = $(row.id);
    if (old && old.dataset.state !== row.dataset.state) say(row.dataset.announce);
  }
}

function say(text) {
  $("status").textContent = text;
}

// --- beginning -----------------------------------------------------------------------------------

function prepareDrop() {
  const zone = document.querySelector(".zone");
  document.querySelector("[data-needs-script]").hidden = false;
  $("drop").addEventListener("submit", (event) => event.preventDefault());
  $("files").addEventListener("change", () => {
    addFiles([...$("files").files]);
    $("files").value = "";
  });
  for (const name of ["dragover", "dragleave", "drop"]) {
    document.addEventListener(name, (event) => {
      event.preventDefault();
      zone.classList.toggle("is-over", name === "dragover");
      if (name === "drop") addFiles([...event.dataTransfer.files]);
    });
  }
  window.addEventListener("beforeunload", (event) => {
    if (sending || waiting.length) event.preventDefault();
  });
}

document.addEventListener("click", async (event) => {
  const button = event.target.closest("[data-copy]");
  if (!button) return;
  try {
    await navigator.clipboard.writeText(button.dataset.copy);
    button.textContent = button.dataset.done;
  } catch {
    window.prompt(button.textContent, button.dataset.copy); // where the clipboard needs https
  }
});
document.addEventListener("visibilitychange", () => {
  if (!document.hidden && $("rows")) refresh();
});
if ($("drop")) prepareDrop();
if ($("rows")) timer = setTimeout(refresh, FAST_MS);
