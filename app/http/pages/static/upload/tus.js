// Upload one file by tus 1.0, in pieces. Bytes that arrived before the network was lost count; the upload
// waits for the network. A piece that is refused as too large is halved.

import { fingerprint, forget, recall, remember } from "./memory.js";
import { pause } from "../say.js";

const KIB = 1024;
const FIRST_PIECE = 1024 * KIB; // small, so that the server can soon inspect the file
const LARGEST_PIECE = 512 * 1024 * KIB; // received bytes of an interrupted piece count, so large pieces cost nothing
const SMALLEST_PIECE = 512 * KIB;
const PACKED_PIECE = 8192 * KIB; // a compressed piece counts only if it is complete
const FAST = 12e6; // bytes per second; on a faster network compression only costs time
const SLOW = 3e6; // below this the network itself is slow; above it the first piece may only have been delayed
const PACKS_WELL = /\.(csv|tsv|txt|mvnx)$/i;
const MOST_TRIES = 12;
const LONGEST_PAUSE_MS = 20000;
export const TUS = { "Tus-Resumable": "1.0.0" };

export class Refusal extends Error {
  constructor(problem) {
    super(problem.code);
    this.problem = problem;
  }
}

class Lost extends Error {}

export class TusUpload {
  // on: {progress(bytes), piece(), smaller(bytes), waiting()}
  constructor(file, options, root, on) {
    Object.assign(this, { file, options, root, on, offset: 0, piece: LARGEST_PIECE, address: null, request: null, stopped: false, speed: {} });
  }

  // Send the whole file and return the id of the recording.
  async send() {
    let tries = 0;
    for (;;) {
      const before = this.offset;
      try {
        return await this.go();
      } catch (error) {
        if (!(error instanceof Lost) || this.stopped) throw error;
        tries = this.offset > before ? 1 : tries + 1;
        if (tries > MOST_TRIES) throw error;
        this.on.waiting();
        await pause(Math.min(500 * 2 ** tries, LONGEST_PAUSE_MS));
      }
    }
  }

  async go() {
    let answer = await this.find();
    while (!answer.recording) {
      answer = await this.sendPiece();
      this.on.piece();
    }
    return answer.recording;
  }

  // Resume a known upload of this file, or announce a new one.
  async find() {
    const known = this.address || recall()[fingerprint(this.file)]?.address;
    if (known) {
      const answer = await this.ask("HEAD", known, {});
      if (answer.status === 200) {
        this.address = known;
        return this.read(answer);
      }
      forget(this.file);
    }
    const answer = await this.ask("POST", this.root, { "Upload-Length": this.file.size, "Upload-Metadata": describe(this.file, { folder: this.options.folder, settings: declareAnalysis(this.options) }) });
    if (answer.status !== 201) throw refuse(answer);
    this.address = this.root + "/" + answer.getResponseHeader("Location").split("/").pop();
    remember(this.file, { address: this.address, ...this.options });
    this.offset = 0;
    return { recording: null };
  }

  async sendPiece() {
    const isPacked = this.shouldPack();
    const size = Math.min(this.piece, !this.offset ? FIRST_PIECE : isPacked || this.isUnsure ? PACKED_PIECE : LARGEST_PIECE);
    const body = this.file.slice(this.offset, this.offset + size);
    const headers = { "Upload-Offset": this.offset, "Content-Type": "application/offset+octet-stream" };
    const began = performance.now();
    if (isPacked) headers["Content-Encoding"] = "gzip";
    const answer = await this.ask("PATCH", this.address, headers, isPacked ? await pack(body) : body, body.size);
    if (answer.status === 204) {
      this.speed[isPacked ? "packed" : "plain"] = (1000 * body.size) / (performance.now() - began);
      return this.read(answer);
    }
    if (answer.status === 413 && this.piece > SMALLEST_PIECE && !isOurs(answer)) {
      this.piece = Math.max(SMALLEST_PIECE, Math.min(size, this.piece) / 2);
      this.on.smaller(this.piece);
      return { recording: null };
    }
    if ([404, 409, 410, 423, 429].includes(answer.status)) throw new Lost(); // ask for the offset and retry
    throw refuse(answer);
  }

  // Compress tables if the network is slower than compression, each piece separately; offsets are in the
  // original file.
  shouldPack() {
    const { plain, packed = Infinity } = this.speed;
    return this.packsWell && !this.isUnsure && plain < Math.min(FAST, packed);
  }

  get packsWell() {
    return PACKS_WELL.test(this.file.name) && "CompressionStream" in window;
  }

  // The first piece was neither fast nor slow, so a larger one decides.
  get isUnsure() {
    return this.packsWell && this.offset === FIRST_PIECE && this.speed.plain >= SLOW && this.speed.plain < FAST;
  }

  read(answer) {
    this.offset = Number(answer.getResponseHeader("Upload-Offset"));
    this.on.progress(this.offset);
    return { recording: answer.getResponseHeader("Acromion-Recording") };
  }

  // size: how many bytes of the file a compressed body contains.
  ask(method, address, headers, body = null, size = 0) {
    return new Promise((resolve, reject) => {
      if (this.stopped) return reject(new Lost());
      const request = new XMLHttpRequest();
      this.request = request;
      request.open(method, address);
      for (const [name, value] of Object.entries({ ...TUS, ...headers })) request.setRequestHeader(name, value);
      request.upload.addEventListener("progress", (event) => body && this.on.progress(this.offset + (event.loaded / body.size) * size));
      request.addEventListener("load", () => ([502, 503, 504, 408].includes(request.status) && !isOurs(request) ? reject(new Lost()) : resolve(request)));
      for (const end of ["error", "abort", "timeout"]) request.addEventListener(end, () => reject(new Lost()));
      request.send(body);
    });
  }

  // Stop at once and delete the upload.
  stop() {
    this.stopped = true;
    this.request?.abort();
    forget(this.file);
    return deleteUpload(this.address);
  }
}

// Ask the server to delete an upload. Retry, because it may still be writing the last piece (423) or be
// offline.
export async function deleteUpload(address) {
  for (let tries = 0; address && tries < MOST_TRIES; tries += 1) {
    const answer = await fetch(address, { method: "DELETE", headers: TUS }).catch(() => null);
    if (answer && answer.status !== 423) return;
    await pause(Math.min(250 * 2 ** tries, LONGEST_PAUSE_MS));
  }
}

function pack(blob) {
  return new Response(blob.stream().pipeThrough(new CompressionStream("gzip"))).blob();
}

function describe(file, words) {
  const said = Object.entries({ filename: file.name, ...words }).filter(([, value]) => value);
  return said.map(([name, value]) => `${name} ${toBase64(value)}`).join(",");
}

// Declare the analysis, which starts with the last byte and uses the language of this page.
function declareAnalysis({ study }) {
  return JSON.stringify({ lang: document.documentElement.lang, study });
}

function toBase64(text) {
  return btoa(String.fromCharCode(...new TextEncoder().encode(text)));
}

function isOurs(answer) {
  return (answer.getResponseHeader("Content-Type") || "").startsWith("application/problem+json");
}

function refuse(answer) {
  return isOurs(answer) ? new Refusal(JSON.parse(answer.responseText)) : new Lost();
}
