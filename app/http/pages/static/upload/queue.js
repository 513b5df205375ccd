// All selected files: three upload at a time, the others wait. The analysis of each file is declared when its
// upload starts, and begins with the last byte even if this page is closed.

import { $, fill, pause, say } from "../say.js";
import { formatMoment } from "../times.js";
import { readFolder } from "./drop.js";
import { forget, recall, fingerprint } from "./memory.js";
import { Row } from "./row.js";
import { deleteUpload, Refusal, TUS, TusUpload } from "./tus.js";
import { formatSize } from "./sizes.js";

const AT_ONCE = 3;
const LOOK_MS = 400;
const MOST_LOOKS = 20;
const MOST_TRIES = 12;
const LONGEST_PAUSE_MS = 20000;

export class Queue {
  constructor(api, onChange, onAdded) {
    Object.assign(this, { api, onChange, onAdded, waiting: [], going: new Set(), all: new Set() });
  }

  add(files, values) {
    const added = files.map((file) => ({ file }));
    for (const entry of added) {
      const { file } = entry;
      const kept = recall()[fingerprint(file)] || {}; // stated before a reload
      entry.study = values.study || kept.study || "";
      entry.row = new Row(file, { cancel: () => this.cancel(entry), retry: () => this.retry(entry), remove: () => this.remove(entry) });
      this.all.add(entry);
      this.waiting.push(entry);
    }
    added[0]?.row.item.scrollIntoView({ block: "nearest" });
    this.next();
  }

  get isBusy() {
    return this.going.size + this.waiting.length > 0;
  }

  // For each file that is neither refused nor complete: its name and the key of its row in the list. The key
  // is "" until it is known; the analysis may start before the page receives the recording's id.
  get open() {
    return [...this.all].filter(({ row }) => !row.isOver).map((entry) => ({ key: entry.key || "", name: entry.file.name }));
  }

  next() {
    while (this.going.size < AT_ONCE && this.waiting.length) this.start(this.waiting.shift());
    this.onChange();
  }

  async start(entry) {
    const { row, file } = entry;
    const words = row.words;
    if (file.size > Number(words.maxBytes)) return this.refuseLarge(entry);
    this.going.add(entry);
    row.show("uploading");
    entry.upload = new TusUpload(file, { study: entry.study, folder: readFolder(file) }, this.api + "/uploads", {
      progress: (bytes) => (row.state === "lost" && row.show("uploading"), row.progress(bytes)),
      piece: () => this.inspect(entry),
      smaller: (bytes) => row.note(fill(words.smaller, { size: formatSize(bytes, row.units) })),
      waiting: () => row.show("lost"),
    });
    try {
      const recordingId = await entry.upload.send();
      await this.retryWhileOffline(entry, () => this.complete(entry, recordingId));
    } catch (error) {
      if (!entry.upload.stopped) error instanceof Refusal ? row.refuse(error.problem) : row.loseNetwork();
    }
    this.going.delete(entry);
    this.next();
  }

  // Repeat the request until the server responds, so that a lost network after the last byte loses nothing.
  async retryWhileOffline(entry, act) {
    for (let tries = 1; ; tries += 1) {
      try {
        return await act();
      } catch (error) {
        if (error instanceof Refusal || tries > MOST_TRIES || entry.isCancelled) throw error;
        entry.row.show("lost");
        await pause(Math.min(500 * 2 ** tries, LONGEST_PAUSE_MS));
      }
    }
  }

  refuseLarge({ row, file }) {
    const { tooBig, tooBigDetail, tooBigFix, maxBytes } = row.words;
    const facts = { size: formatSize(file.size, row.units), max: formatSize(Number(maxBytes), row.units) };
    row.refuse({ title: tooBig, detail: fill(tooBigDetail, facts), fix: tooBigFix, code: "E-BIG", retryable: false });
  }

  // Poll the inspection of the first bytes until it has a result.
  async inspect(entry) {
    if (entry.looked) return;
    entry.looked = true;
    for (let k = 0; k < MOST_LOOKS && !entry.upload.stopped; k += 1) {
      const answer = await fetch(entry.upload.address + "/inspection").catch(() => null);
      if (answer && answer.status >= 400) return this.warn(entry, answer);
      const found = answer ? await answer.json() : {};
      if (found.device) return entry.row.showFacts(this.describe(found, entry.row.words));
      await new Promise((resolve) => setTimeout(resolve, LOOK_MS));
    }
  }

  // Warn at once if the first bytes are not a recording, before the whole upload; the analysis will explain
  // more.
  async warn({ row }, answer) {
    const { title, fix } = await answer.json().catch(() => ({}));
    if (answer.status === 422 && title) row.note(`${title}. ${fix}`);
  }

  describe(found, words) {
    const rate = found.rate_hz ? `${Math.round(found.rate_hz).toLocaleString(document.documentElement.lang)} Hz` : "";
    const start = formatMoment(found.start || "");
    const zone = found.start && found.time_zone ? `(${found.time_zone})` : "";
    const device = JSON.parse(words.devices)[found.device] || found.device;
    return [device, rate, [start, zone].filter(Boolean).join(" ")].filter(Boolean).join(" · ");
  }

  // Complete an upload. The analysis has usually started; if it has not (an identical one exists, or the
  // queue was full), request it here. The file is remembered until the analysis exists.
  async complete(entry, recordingId) {
    entry.key = `of-${recordingId}`;
    const recording = await this.get(`/recordings/${recordingId}`);
    const begun = (await this.get(`/analyses?recording_id=${recordingId}&limit=1`)).items[0];
    const upload = await this.get(`/uploads/${entry.upload.address.split("/").pop()}`);
    if (upload.is_repeated) return this.completeRepeated(entry, recordingId, begun, upload);
    if (begun) return this.added(entry);
    if (recording.duplicate_of) {
      const earlier = await this.get(`/analyses?recording_id=${recording.duplicate_of}&limit=1`);
      if (earlier.items.some(({ state }) => !["failed", "cancelled"].includes(state))) {
        await this.drop(entry, recordingId);
        if (entry.study) await this.send("POST", "/analyses", { recording_ids: [recording.duplicate_of], study: entry.study });
        return this.offer(entry, recording.duplicate_of, earlier.items[0]);
      }
    }
    if (entry.isCancelled) return this.drop(entry, recordingId);
    await this.send("POST", "/analyses", { recording_ids: [recordingId], settings: this.settings(), study: entry.study });
    this.added(entry);
  }

  // Handle a file that was sent before: its recording is never deleted here.
  async completeRepeated(entry, recordingId, begun, upload) {
    if (begun && begun.created_at >= upload.created_at) return this.added(entry);
    if (begun && !["failed", "cancelled"].includes(begun.state)) {
      forget(entry.file);
      if (entry.study) await this.send("POST", "/analyses", { recording_ids: [recordingId], study: entry.study });
      return this.offer(entry, recordingId, begun);
    }
    if (entry.isCancelled) return forget(entry.file);
    await this.send("POST", "/analyses", { recording_ids: [recordingId], settings: this.settings(), study: entry.study });
    this.added(entry);
  }

  async drop(entry, recordingId) {
    await this.erase(recordingId);
    forget(entry.file);
  }

  // Delete permanently; use the trash if permission is missing or the password was entered too long ago.
  async erase(recordingId) {
    const address = `${this.api}/recordings/${recordingId}`;
    const answer = await fetch(`${address}?purge=now`, { method: "DELETE" });
    if (answer.status === 403) await fetch(address, { method: "DELETE" });
  }

  // Return whether an upload is complete and its analysis has started.
  async hasAnalysis(address) {
    if (!address) return false;
    const answer = await fetch(address, { method: "HEAD", headers: TUS }).catch(() => null);
    const recordingId = answer?.headers.get("Acromion-Recording");
    const found = recordingId && (await this.get(`/analyses?recording_id=${recordingId}&limit=1`).catch(() => null));
    return Boolean(found?.items.length);
  }

  // Delete an unwanted upload, and its recording unless that is being analysed.
  async discard(address) {
    const answer = await fetch(address, { method: "HEAD", headers: TUS }).catch(() => null);
    const recordingId = answer?.headers.get("Acromion-Recording");
    await deleteUpload(address);
    if (answer?.headers.get("Acromion-Repeated")) return;
    const found = recordingId && (await this.get(`/analyses?recording_id=${recordingId}&limit=1`).catch(() => null));
    if (!found || found.items.length) return;
    await this.erase(recordingId).catch(() => null);
  }

  offer(entry, recordingId, { id, created_at: when }) {
    const page = this.api.replace(/\/api\/v1$/, "") + `/analyses/${id}`;
    entry.row.duplicate({ page, when: when.slice(0, 10) }, () => this.repeat(entry, recordingId));
  }

  async repeat(entry, recordingId) {
    const { row } = entry;
    try {
      await this.send("POST", "/analyses", { recording_ids: [recordingId], settings: this.settings(), again: true, study: entry.study });
      entry.key = `of-${recordingId}`;
      this.added(entry);
    } catch (error) {
      const problem = error instanceof Refusal ? error.problem : { title: row.words.network, fix: row.words.networkFix };
      row.note(`${problem.title}. ${problem.fix}`);
    }
  }

  settings() {
    return { lang: document.documentElement.lang };
  }

  added(entry) {
    forget(entry.file);
    say(fill(entry.row.words.added, { name: entry.file.name }));
    this.onAdded(entry).finally(() => this.remove(entry));
  }

  async get(path) {
    return this.send("GET", path);
  }

  async send(method, path, body) {
    const headers = body ? { "Content-Type": "application/json" } : {};
    const answer = await fetch(this.api + path, { method, headers, body: body && JSON.stringify(body) });
    const result = await answer.json();
    if (!answer.ok) throw new Refusal(result);
    return result;
  }

  cancel(entry) {
    entry.isCancelled = true;
    entry.upload?.stop();
    this.waiting = this.waiting.filter((other) => other !== entry);
    this.remove(entry);
    this.onChange();
  }

  retry(entry) {
    entry.looked = false;
    entry.row.show("waiting");
    this.waiting.push(entry);
    this.next();
  }

  get failed() {
    return [...this.all].filter((entry) => entry.row.state === "refused" && entry.row.isRetryable);
  }

  retryAll() {
    for (const entry of this.failed) this.retry(entry);
  }

  remove(entry) {
    this.all.delete(entry);
    entry.row.remove();
    this.onChange();
  }
}
