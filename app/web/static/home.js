// The first page: files in, and what has become of them.

import { $, fill, say } from "./say.js";
import { refresh, showTitle } from "./rows.js";
import { keepRecordings, readDrop } from "./upload/drop.js";
import { recall } from "./upload/memory.js";
import { Queue } from "./upload/queue.js";

const form = $("drop");
const words = $("upload").dataset;
const queue = new Queue(form.dataset.api, showQueue, refresh);

function showQueue() {
  showTitle(queue.open);
  $("retry-all").hidden = queue.failed.length < 2;
  showInterrupted();
}

// Uploads that a reload or a closed browser has cut: the same files, chosen again, go on where they stopped.
function showInterrupted() {
  const going = new Set([...queue.all].map((entry) => entry.file.name));
  const names = Object.values(recall()).map((kept) => kept.name).filter((name) => !going.has(name));
  $("interrupted").hidden = !names.length;
  $("interrupted").textContent = fill(words.interrupted, { names: names.join(", ") });
}

function take({ files, ignored }) {
  const chosen = new FormData(form);
  queue.add(files, { subject: chosen.get("subject").trim(), side: chosen.get("side") });
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
    take(keepRecordings([...$("folder").files]));
    $("folder").value = "";
  });
  for (const name of ["dragover", "dragleave", "drop"]) {
    document.addEventListener(name, async (event) => {
      event.preventDefault();
      zone.classList.toggle("is-over", name === "dragover");
      if (name === "drop") take(await readDrop(event.dataTransfer));
    });
  }
  $("retry-all").addEventListener("click", () => queue.retryAll());
  window.addEventListener("beforeunload", (event) => queue.isBusy && event.preventDefault());
}

listen();
showInterrupted();
