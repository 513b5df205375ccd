// Uploads a file with tus-js-client in small pieces, breaks off in the middle, and goes on in a new upload.
// node upload.mjs ENDPOINT FILE TUS_JS_CLIENT_FOLDER; prints the address of the recording's upload.
import { createReadStream, statSync } from "node:fs";
import { createRequire } from "node:module";

const [endpoint, path, folder] = process.argv.slice(2);
const tus = createRequire(folder + "/")("tus-js-client");
const size = statSync(path).size;

function start(uploadUrl, stopAt) {
  return new Promise((resolve, reject) => {
    const upload = new tus.Upload(createReadStream(path), {
      endpoint,
      uploadUrl,
      uploadSize: size,
      chunkSize: 100_000,
      metadata: { filename: "shift.gt3x", filetype: "application/octet-stream" },
      retryDelays: [0, 100, 500],
      onError: reject,
      onChunkComplete: (_chunk, accepted) => {
        if (accepted >= stopAt && accepted < size) upload.abort().then(() => resolve(upload.url));
      },
      onSuccess: () => resolve(upload.url),
    });
    upload.start();
  });
}

const address = await start(null, size / 2);
console.log(await start(address, Infinity));
