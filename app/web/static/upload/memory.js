// Which uploads are half done, so that the same file chosen again goes on where it stopped. The browser keeps
// it; the bytes themselves are on the server.

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

export function remember(file, address) {
  write({ ...recall(), [fingerprint(file)]: { address, name: file.name } });
}

export function forget(print) {
  const kept = recall();
  delete kept[print];
  write(kept);
}

function write(kept) {
  try {
    localStorage.setItem(KEY, JSON.stringify(kept));
  } catch {
    // private browsing: an upload then starts anew after a reload
  }
}
