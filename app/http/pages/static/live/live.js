// The live page: start, show and stop a session. The session runs on the server.

import { $, fill, pause, say } from "../say.js";
import { formatDuration, formatElapsed } from "../times.js";
import { Cues } from "./cues.js";
import { Strip, turnArm } from "./draw.js";
import { Link } from "./link.js";
import { SENSORS } from "./sensors.js";

const texts = JSON.parse($("texts").textContent);
const form = $("start");
const base = form.dataset.base, language = form.dataset.lang;
const cues = new Cues();
const strip = new Strip($("strip"));
const number = (digits) => new Intl.NumberFormat(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
const whole = number(0), tenth = number(1);
const OLD_MS = 1000, CUE_MS = 5000, TRY_MS = 3000, MOST_TRIES = 100, LATENCIES = 25, MOST_STILL_MG = 50;
const state = { newest: null, isDrawing: false, latencies: [], pose: "", shownAt: 0 };

const address = new URL(`${base}/api/v1/live`, location.href);
address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
const link = new Link(address, language, take);

function take(message) {
  const how = { session: begin, history: addHistory, update, ended: end, problem: refuse, lost: lose, cue: showCue, cues: showQuiet, mark: showMark }[message.type];
  how?.(message);
}

function begin(message) {
  form.hidden = $("end").hidden = $("problem").hidden = $("link").hidden = $("preparing").hidden = true;
  $("intro").hidden = true;
  $("session").hidden = false;
  $("reopen").hidden = sensor !== null || !sessionStorage.getItem(KIND);
  $("what").textContent = fill(texts.what, { source: message.source === "demo" ? texts.demo : message.source, rate: whole.format(message.rate_hz) });
  $("quiet").hidden = !message.cues.length;
  showQuiet({ paused: message.cues_paused });
  $("mark").hidden = $("mark-field").hidden = !message.keeps;
  $("marked").hidden = true;
}

function showMark(message) {
  const told = fill(texts.marked, { n: message.count, time: formatElapsed(message.time_s) });
  $("marked").textContent = message.label ? `${told}: ${message.label}` : told;
  $("marked").hidden = false;
}

function addHistory(message) {
  strip.clear();
  strip.add(message.points);
  update(message);
}

function update(message) {
  if (message.type === "update") strip.add(message.points);
  state.newest = message;
  if (state.isDrawing) return;
  state.isDrawing = true;
  requestAnimationFrame(draw);
}

function draw() {
  state.isDrawing = false;
  const { status, came_s: cameS, type } = state.newest;
  const deg = status.elevation_deg;
  $("angle").textContent = deg === null ? "–" : `${whole.format(Math.round(deg))}°`;
  $("angle").parentElement.classList.remove("is-old");
  turnArm($("limb"), deg);
  strip.draw();
  $("above").textContent = formatDuration(status.above_s[1]);
  $("rises").textContent = whole.format(status.rises);
  $("elapsed").textContent = formatElapsed(status.elapsed_s);
  $("lost").textContent = whole.format(status.lost);
  $("missing").textContent = formatDuration(status.missing_s);
  $("doubt").hidden = status.has_rested || deg === null;
  $("frame").hidden = !status.is_frame_doubtful;
  showPose(status);
  state.shownAt = performance.now();
  if (type === "update") measure(cameS);
}

// Measure the time from the arrival of frames at the server to the next drawn picture.
function measure(cameS) {
  requestAnimationFrame(() => {
    state.latencies.push(link.since(cameS));
    if (state.latencies.length > LATENCIES) state.latencies.shift();
    const middle = [...state.latencies].sort((a, b) => a - b)[Math.floor(state.latencies.length / 2)];
    $("latency").textContent = `${whole.format(Math.max(0, middle))} ms`;
    $("latency").dataset.ms = state.latencies.at(-1).toFixed(1);
  });
}

function showPose(status) {
  const left = whole.format(Math.ceil(status.pose_left_s));
  const refused = status.pose_refused && status.pose !== "holding" ? `${texts.refused[status.pose_refused]} ` : "";
  const text = refused + ({ countdown: fill(texts.countdown, { left }), holding: fill(texts.holding, { left, still: whole.format(1000 * status.still_g), most: whole.format(MOST_STILL_MG) }), none: texts.no_pose }[status.pose] ?? "");
  if (text === state.pose) return;
  if (state.pose && !text) say(texts.pose_held);
  $("pose").style.setProperty("--moved", status.pose === "holding" ? Math.min(1, (1000 * status.still_g) / MOST_STILL_MG) : 0);
  state.pose = text;
  $("pose").textContent = text;
  $("pose").hidden = !text;
}

function showCue(message) {
  cues.notify();
  $("cue").textContent = fill(texts.cue[message.kind], { angle: message.angle_deg, limit: message.limit });
  $("cue").hidden = false;
  clearTimeout(state.cueTimer);
  state.cueTimer = setTimeout(() => ($("cue").hidden = true), CUE_MS);
}

function showQuiet(message) {
  state.isQuiet = message.paused;
  $("quiet").setAttribute("aria-pressed", String(message.paused));
}

function end(message) {
  closeSensor();
  $("session").hidden = true;
  $("intro").hidden = false;
  $("end").hidden = false;
  const left = message.was_left ? `${texts.was_left} ` : "";
  $("ended-words").textContent = left + describeEnd(message);
  $("report").hidden = !message.analysis;
  if (message.analysis) $("report").href = `${base}/analyses/${message.analysis}`;
  $("difference").hidden = true;
  if (message.analysis) showDifference(link.session);
  if (document.fullscreenElement) document.exitFullscreen();
  $("end").scrollIntoView({ block: "nearest" });
  say($("ended-words").textContent);
}

function describeEnd(message) {
  if (message.state === "failed") return message.analysis ? texts.broke_off : texts.failed;
  return message.analysis ? texts.kept : texts.played;
}

// Show the difference between live angles and report, once the report exists.
async function showDifference(session) {
  for (let tries = 0; tries < MOST_TRIES && !$("end").hidden; tries++) {
    const answer = await fetch(`${base}/api/v1/live/${session}/difference?lang=${language}`).catch(() => null);
    if (answer?.ok) {
      $("difference").textContent = (await answer.json()).text;
      $("difference").hidden = false;
      return;
    }
    await pause(TRY_MS);
  }
}

function refuse(message) {
  closeSensor();
  $("preparing").hidden = true;
  const wasShown = !$("session").hidden;
  $("intro").hidden = false;
  $("session").hidden = true;
  form.hidden = false;
  $("problem").hidden = false;
  $("problem").textContent = message.code === "E-NOT-FOUND" && wasShown ? texts.session_gone : `${message.title}. ${message.detail} ${message.fix}`;
}

function lose() {
  $("link").hidden = $("session").hidden;
  if (link.session) return;
  $("preparing").hidden = true;
  $("problem").hidden = false;
  $("problem").textContent = texts.no_link;
}

async function listRecordings() {
  const wanted = new URLSearchParams(location.search).get("recording");
  try {
    const answer = await fetch(`${base}/api/v1/recordings?limit=50`);
    for (const item of (await answer.json()).items) {
      const name = [item.subject, item.file_name].filter(Boolean).join(" · ");
      $("recordings").append(new Option(name, item.id, item.id === wanted, item.id === wanted));
    }
  } catch {
    // the demonstration works without recordings
  }
  $("recordings").hidden = !$("recordings").children.length;
  showAsked();
}

// Return the kind of the selected source: demo, recording or a kind of sensor.
function readKind() {
  const option = $("source").selectedOptions[0];
  return option.dataset.kind ?? (option.value === "demo" ? "demo" : "recording");
}

// Show only the fields that apply to the kind of source.
function showAsked() {
  const isSensor = !["demo", "recording"].includes(readKind());
  for (const part of form.querySelectorAll("[data-for]")) part.hidden = (part.dataset.for === "sensor") !== isSensor;
}

function readRules(asked) {
  return asked.getAll("rule").map((kind) => ({ kind, angle_deg: Number(asked.get(`${kind}-angle`)), limit: Number(asked.get(`${kind}-limit`)) }));
}

function readAsked() {
  return { ...readSource(), cues: readRules(new FormData(form)) };
}

function readSource() {
  const kind = readKind(), chosen = $("source").value, asked = new FormData(form);
  if (kind === "demo" || kind === "recording") return { source: kind, speed: Number(asked.get("speed")), ...(kind === "recording" && { recording: chosen }) };
  const whose = { subject: asked.get("subject") ?? "", side: asked.get("side") || null, axis: asked.get("axis") || null };
  return { source: kind, keeps: true, ...whose, ...(kind === "port" && { port: chosen }) };
}

const KIND = "acromion-live-kind";
let sensor = null;

// Open the sensor in the click handler of the start button, because browsers ask for permission there.
async function openSensor(kind) {
  sensor = await SENSORS[kind].open((bytes) => link.push(bytes), failSensor);
  sessionStorage.setItem(KIND, kind);
  $("reopen").hidden = true;
}

function failSensor(error) {
  $("preparing").hidden = true;
  $("problem").hidden = false;
  $("problem").textContent = `${texts.sensor_failed} ${error?.message ?? ""}`;
  $("reopen").hidden = $("session").hidden;
}

function closeSensor() {
  Promise.resolve(sensor?.close()).catch(() => {});
  sensor = null;
  sessionStorage.removeItem(KIND);
}

async function openAndStart() {
  const asked = readAsked(), kind = readKind();
  sessionStorage.removeItem(KIND);
  try {
    if (kind in SENSORS) await openSensor(kind);
    link.start(kind in SENSORS ? { ...asked, source: "lines", name: sensor.name } : asked);
    await navigator.wakeLock?.request("screen").catch(() => {});
  } catch (error) {
    failSensor(error);
  }
}

function offerSensors() {
  for (const option of form.querySelectorAll("option[data-kind]")) {
    const kind = option.dataset.kind;
    if (kind in SENSORS && !SENSORS[kind].isThere()) option.remove();
  }
}

$("reopen").addEventListener("click", () => openSensor(sessionStorage.getItem(KIND)).catch(failSensor));
$("source").addEventListener("change", showAsked);
form.addEventListener("submit", (event) => {
  event.preventDefault();
  $("preparing").hidden = false;
  cues.choose(new FormData(form).getAll("way"));
  $("problem").hidden = true;
  $("begin").disabled = true;
  setTimeout(() => ($("begin").disabled = false), OLD_MS);
  openAndStart();
});
$("redo").addEventListener("click", () => link.send({ type: "pose" }));
$("stop").addEventListener("click", () => link.send({ type: "stop" }));
$("mark").addEventListener("click", () => link.send({ type: "mark", label: $("mark-label").value.trim() }));
$("quiet").addEventListener("click", () => link.send({ type: "cues", paused: !state.isQuiet }));
$("wide").addEventListener("click", () => $("session").requestFullscreen?.());
$("again").addEventListener("click", () => {
  $("end").hidden = true;
  form.hidden = false;
  $("source").focus();
});
document.addEventListener("keydown", (event) => {
  if ($("session").hidden || event.target.matches("input, select") || event.ctrlKey || event.metaKey || event.altKey) return;
  const button = { p: "redo", s: "stop", f: "wide", c: "quiet", m: "mark" }[event.key.toLowerCase()];
  if (button && !$(button).hidden) $(button).click();
});
// Mark the angle as outdated if no new one arrives.
setInterval(() => {
  if (!$("session").hidden && performance.now() - state.shownAt > OLD_MS) $("angle").parentElement.classList.add("is-old");
}, OLD_MS / 2);

offerSensors();
listRecordings();
const remembered = Link.remembered();
if (remembered) link.resume(remembered);
