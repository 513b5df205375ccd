// Dropped or selected files and folders.

const ACCEPTED = /\.(gt3x|cwa|csv|gz|zip|dat|txt|bin|parquet|mvnx)$/i;

// Return all files of a drop, including those in folders: {files, ignored, folder}; folder: its name if it is
// one.
export async function readDrop(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  const loose = [...transfer.files];
  if (!entries.some((entry) => entry.isDirectory)) return { files: loose, ignored: 0 };
  const folder = entries.length === 1 ? entries[0].name : "";
  return { ...keepRecordings((await Promise.all(entries.map(walk))).flat()), folder };
}

// Keep only files of a folder that can be recordings; individually selected files are always kept.
export function keepRecordings(files) {
  const kept = files.filter((file) => ACCEPTED.test(file.name) && !/^(\.|~\$)/.test(file.name));
  kept.sort((one, other) => one.name.localeCompare(other.name, undefined, { numeric: true }));
  return { files: kept, ignored: files.length - kept.length };
}

// Return the folders of a file below the dropped one, which may name its person and arm: "P01/right".
export function readFolder(file) {
  return (file.droppedPath || file.webkitRelativePath || "").split("/").filter(Boolean).slice(1, -1).join("/");
}

async function walk(entry) {
  const keep = (file) => Object.assign(file, { droppedPath: entry.fullPath });
  if (entry.isFile) return new Promise((resolve) => entry.file((file) => resolve([keep(file)]), () => resolve([])));
  const reader = entry.createReader();
  const found = [];
  for (;;) {
    const some = await new Promise((resolve) => reader.readEntries(resolve, () => resolve([])));
    if (!some.length) break;
    found.push(...some); // a reader returns at most 100 entries at a time
  }
  return (await Promise.all(found.map(walk))).flat();
}
