// One Pico behind standard input and output.
//
// usage: serve.mjs IMAGE UID [STORAGE]      IMAGE: a path; UID: of its flash, 16 hexadecimal digits; STORAGE: a file that keeps the storage
// of its flash over a power cycle, from the first time that something is written there
import fs from 'node:fs';
import { pico, serve } from './served.mjs';
import { bytes } from './words.mjs';

const [image, uid, kept] = process.argv.slice(2);
const storage = kept && fs.existsSync(kept) ? fs.readFileSync(kept) : null;
const board = pico({ image, uid: bytes(uid), storage });

// Flash operations that the file knows of.
let written = 0;

// The power may go at any moment: the file has all that the flash had after an operation.
function keep() {
  if (!kept || board.nor.operations === written) return;
  written = board.nor.operations;
  fs.writeFileSync(`${kept}.new`, board.storage());
  fs.renameSync(`${kept}.new`, kept);
}

serve(board, { afterTurn: keep });
