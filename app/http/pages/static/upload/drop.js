// Files that are dropped or chosen, and whole folders of them.

const ACCEPTED = /\.(gt3x|cwa|csv|gz|zip|dat|txt|bin|parquet|mvnx)$/i;

// Give every file of a drop, also those inside folders: {files, ignored, folder}; the folder's name if it is one.
export async function readDrop(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  const loose = [...transfer.files];
  if (!entries.some((entry) => entry.isDirectory)) return { files: loose, ignored: 0 };
  const folder = entries.length === 1 ? entries[0].name : "";
  return { ...keepRecordings((await Promise.all(entries.map(walk))).flat()), folder };
}

// Of a folder only what can be a recording is taken; a file that was chosen by itself always is.
export function keepRecordings(files) {
  const kept = files.filter((file) => ACCEPTED.test(file.name) && !/^(\.|~\$)/.test(file.name));
  kept.sort((one, other) => one.name.localeCompare(other.name, undefined, { numeric: true }));
  return { files: kept, ignored: files.length - kept.length };
}

async function walk(entry) {
  if (entry.isFile) return new Promise((resolve) => entry.file((file) => resolve([file]), () => resolve([])));
  const reader = entry.createReader();
  const found = [];
  for (;;) {
    const some = await new Promise((resolve) => reader.readEntries(resolve, () => resolve([])));
    if (!some.length) break;
    found.push(...some); // a reader gives at most a hundred at a time
  }
  return (await Promise.all(found.map(walk))).flat();
}
