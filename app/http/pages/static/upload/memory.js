// Interrupted uploads and their descriptions, so that selecting the same file again resumes its upload. The
// browser keeps them until the analysis is requested; the bytes are on the server.

import { readFolder } from "./drop.js";

const KEY = "acromion.uploads";

// Recordings of several people may have one name, size and time, each in its folder.
export function fingerprint(file) {
  return [readFolder(file), file.name, file.size, file.lastModified].filter((part) => part !== "").join("|");
}

export function recall() {
  try {
    return JSON.parse(localStorage.getItem(KEY)) || {};
  } catch {
    return {};
  }
}

// about: {address} and the description of the file.
export function remember(file, about) {
  const print = fingerprint(file);
  const kept = recall();
  write({ ...kept, [print]: { ...kept[print], name: file.name, ...about } });
}

export function forget(file) {
  forgetPrint(fingerprint(file));
}

export function forgetPrint(print) {
  const kept = recall();
  delete kept[print];
  write(kept);
}

export function write(kept) {
  try {
    localStorage.setItem(KEY, JSON.stringify(kept));
  } catch {
    // private browsing: an upload cannot resume after a reload
  }
}
