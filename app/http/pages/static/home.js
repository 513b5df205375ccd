// The first page: uploads and recordings.

import { $, fill, say } from "./say.js";
import { Cards } from "./finish.js";
import { refresh, showTitle } from "./rows.js";
import { keepRecordings, readDrop } from "./upload/drop.js";
import { forgetPrint, recall, write } from "./upload/memory.js";
import { Queue } from "./upload/queue.js";

const form = $("drop");
const words = $("upload").dataset;
const cards = new Cards($("cards"));
const queue = new Queue(form.dataset.api, showQueue, showAdded);

// Files of a study lead to its page once everything is uploaded; a file that was not added stays in sight first.
let study = "";
let isAdded = false;

function lead() {
  const address = `${$("leads").dataset.address}?${new URLSearchParams({ name: study })}`;
  const isDone = !queue.open.length;
  const { text, ready } = $("leads").dataset;
  $("leads").hidden = !study;
  $("leads").querySelector("span").textContent = fill(isDone ? ready : text, { name: study });
  $("leads").querySelector("a").href = address;
  if (study && isAdded && isDone && !queue.all.size) location.assign(address);
}

function showQueue() {
  showTitle(queue.open);
  lead();
  $("retry-all").hidden = queue.failed.length < 2;
  showInterrupted();
}

// Ask about a new recording; those of a study are described together on its page.
function showAdded({ key, study: of }) {
  isAdded = true;
  if (key && !of) cards.add(`${form.dataset.base}/recordings/${key.slice("of-".length)}/finish`);
  return refresh();
}

// Show uploads that a reload or closed browser interrupted; selecting the same files again resumes them.
function showInterrupted() {
  const names = listInterrupted().map(([, { name }]) => name);
  $("interrupted").hidden = !names.length;
  $("interrupted").querySelector("span").textContent = fill(words.interrupted, { names: names.join(", ") });
}

function listInterrupted() {
  const going = new Set([...queue.all].map((entry) => entry.file.name));
  return Object.entries(recall()).filter(([, { name }]) => !going.has(name));
}

// Forget uploads that are complete and whose analysis has started.
async function forgetArrived() {
  await Promise.all(listInterrupted().map(async ([print, { address }]) => (await queue.hasAnalysis(address)) && forgetPrint(print)));
  showInterrupted();
}

// Discard the interrupted uploads in the browser and on the server.
function discardInterrupted() {
  const left = Object.fromEntries(listInterrupted());
  write(Object.fromEntries(Object.entries(recall()).filter(([print]) => !left[print])));
  for (const { address } of Object.values(left)) queue.discard(address);
  showInterrupted();
}

// The name of a folder is the study name, unless another name was typed.
function take({ files, ignored, folder }) {
  const chosen = new FormData(form);
  const name = chosen.get("study").trim() || (folder || "").slice(0, 100);
  if (files.length) study = name;
  queue.add(files, { study: name });
  if (ignored) say(fill(words.ignored, { n: ignored }));
}

function listen() {
  const zone = document.querySelector(".zone");
  document.querySelector("[data-needs-script]").hidden = false;
  zone.addEventListener("click", (event) => event.target.closest("a, button, input") || $("files").click());
  form.addEventListener("submit", (event) => event.preventDefault());
  $("files").addEventListener("change", () => {
    take({ files: [...$("files").files], ignored: 0 });
    $("files").value = "";
  });
  $("folder").addEventListener("change", () => {
    const files = [...$("folder").files];
    take({ ...keepRecordings(files), folder: files[0]?.webkitRelativePath.split("/")[0] });
    $("folder").value = "";
  });
  for (const name of ["dragover", "dragleave", "drop"]) {
    document.addEventListener(name, async (event) => {
      event.preventDefault();
      zone.classList.toggle("is-over", name === "dragover");
      if (name === "drop") take(await readDrop(event.dataTransfer));
    });
  }
  $("interrupted").querySelector("button").addEventListener("click", discardInterrupted);
  $("retry-all").addEventListener("click", () => queue.retryAll());
  window.addEventListener("beforeunload", (event) => queue.isBusy && event.preventDefault());
}

listen();
forgetArrived();
