// The correction form: add and remove rows, accept proposals, import a diary, undo.

import { $, fill, say } from "../say.js";
import { refuse, send } from "../send.js";
import { TimeFields } from "../time-field.js";
import { Unsent } from "../unsent.js";

const POSE_S = 10;

export function listenToForm(day) {
  const { bands } = day;
  const form = bands.form;
  const empty = [...$("periods").rows].find((row) => !row.querySelector("[name=start]").value);
  if (empty) empty.remove(); // only needed without scripts
  for (const row of form.querySelectorAll("#repeats .window")) if (!row.querySelector("input").value) row.remove();
  bands.last = bands.snapshot();
  day.times = new TimeFields(form, day.clock, () => day.block());
  form.addEventListener("change", ({ target }) => {
    if (target.name === "kind" && target.value === "mark") endNone(day, target.closest(".period"));
    day.changed(true);
  });
  form.addEventListener("click", (event) => act(day, event.target.closest("button")));
  form.addEventListener("focusin", (event) => chooseOf(day, event.target));
  form.addEventListener("submit", (event) => sendForm(day, event));
  day.unsent = new Unsent(form, () => bands.snapshot(), (text) => bands.restore(text));
  for (const answers of document.querySelectorAll(".question form")) answers.addEventListener("submit", (event) => holdBack(day, event));
  $("import").addEventListener("change", () => importDiary(day));
  document.addEventListener("keydown", (event) => {
    const isTyping = event.target.matches("input, textarea, select");
    if (isTyping || event.key.toLowerCase() !== "z" || !(event.ctrlKey || event.metaKey)) return;
    event.preventDefault();
    undo(day);
  });
  for (const button of document.querySelectorAll("[data-look]")) {
    button.hidden = false;
    button.addEventListener("click", () => look(day, button.dataset));
  }
}

// If only one end of a window is typed, fill in the other as shown.
function complete(form) {
  for (const row of form.querySelectorAll(".window")) {
    const ends = [...row.querySelectorAll("input")];
    if (ends.some((end) => end.value.trim())) for (const end of ends) end.value ||= end.placeholder;
  }
}

// A mark is one moment: its row has no end.
function endNone(day, row) {
  const end = row.querySelector("[name=end]");
  end.value = "";
  day.times.check(end);
}

function chooseOf(day, target) {
  const row = target.closest(".period, .window");
  if (!row || row === day.bands.chosen) return;
  day.bands.chosen = row;
  day.draw();
}

function act(day, button) {
  if (!button) return;
  const row = button.closest(".period, .window");
  if (button.dataset.do === "select") day.choose(row);
  if (button.dataset.do === "remove") remove(day, row);
  if (button.dataset.accept) accept(day, button.dataset);
  if (button.id === "add") day.pen.place();
  if (button.id === "hold-again") holdAgain(day);
  if (button.id === "undo") undo(day);
}

// Add a repeated pose in the middle of the view.
function holdAgain(day) {
  const middle = Math.round((day.view.fromS + day.view.toS) / 2);
  const [startS, endS] = [middle - POSE_S / 2, middle + POSE_S / 2];
  const row = day.bands.repeat(day.clock.format(Math.max(0, startS)), day.clock.format(Math.min(day.view.durationS, endS)));
  day.changed(true);
  say(fill(day.words.added, { name: day.words.again }));
  row.querySelector("input").focus();
}

function look(day, { from, to, look: how }) {
  day.view[how || "show"](day.clock.read(from), day.clock.read(to));
  $("day-heading").scrollIntoView({ block: "start" });
}

function remove(day, row) {
  const bands = [...day.bands.windows(), ...day.bands.periods()];
  const name = bands.find((band) => band.row === row).name;
  const next = row.nextElementSibling || row.previousElementSibling;
  const other = row.matches(".window") ? $("hold-again") : $("add");
  row.remove();
  day.changed(true);
  say(fill(day.words.removed, { name }));
  (next?.querySelector("[data-do=remove]") || other).focus();
}

function accept(day, { accept: kind, from, to, span }) {
  const { pose } = day.bands.form.elements;
  if (kind === "still" && pose.value === "axis") pose.value = "n-pose";
  if (kind === "not_worn") {
    day.choose(day.bands.add("not_worn", "", from, to));
  } else if (kind === "repeat") {
    day.choose(day.bands.repeat(from, to));
  } else {
    const row = day.bands.form.querySelector(".window");
    [row.querySelectorAll("input")[0].value, row.querySelectorAll("input")[1].value] = [from, to];
    day.choose(row);
  }
  day.changed(true);
  say(span);
}

function undo(day) {
  if (!day.bands.undo()) return;
  day.restored();
  say(day.words.undone);
}

// An answer makes a new version, so unsent changes must be sent or discarded first.
function holdBack(day, event) {
  if (!day.unsent.isChanged) return;
  event.preventDefault();
  const note = event.target.querySelector("[data-unsent-first]");
  event.submitter.closest("p").after(note);
  note.querySelector("button").onclick = () => (day.unsent.discard(), (note.hidden = true));
  note.hidden = false;
  say(note.firstChild.textContent);
}

async function importDiary(day) {
  const field = $("import");
  const answer = await fetch(field.dataset.to, { method: "POST", body: field.files[0] }).catch(() => null);
  field.value = "";
  $("day-lost").hidden = answer !== null;
  if (!answer) return;
  if (!answer.ok) return refuse($("refused"), await answer.text());
  const rows = await answer.json();
  $("refused").hidden = true;
  const isPosture = rows.length > 0 && rows.every(({ kind }) => kind === "posture");
  for (const row of [...$("periods").rows]) if ((row.querySelector("[name=kind]").value === "posture") === isPosture) row.remove();
  for (const { kind, label, start, end } of rows) day.bands.add(kind, label, start, end);
  day.changed(true);
  say(fill(day.words.imported, { n: rows.length }));
}

function sendForm(day, event) {
  if (event.submitter && "plain" in event.submitter.dataset) return; // a download, left to the browser
  event.preventDefault();
  complete(day.bands.form);
  send(day.bands.form, $("again"), { busy: day.words.busy, lost: $("day-lost"), refused: $("refused") });
}
