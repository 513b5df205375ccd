// Which uploads are half done, and what was said of each, so that the same file chosen again goes on where it
// stopped. The browser keeps it until the analysis is asked for; the bytes themselves are on the server.

const KEY = "acromion.uploads";

export function fingerprint(file) {
  return [file.name, file.size, file.lastModified].join("|");
}

export function recall() {
  try {
    return JSON.parse(localStorage.getItem(KEY)) || {};
  } catch {
    return {};
  }
}

// told: {address} and what a person says of the file.
export function remember(file, told) {
  const print = fingerprint(file);
  const kept = recall();
  write({ ...kept, [print]: { ...kept[print], name: file.name, ...told } });
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
    // private browsing: an upload then starts anew after a reload
  }
}
