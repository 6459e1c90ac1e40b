// One Pico behind standard input and output. Its time goes no faster than the wall clock; where it is slower, it lags.
//
// usage: serve.mjs IMAGE UID [STORAGE]      IMAGE: a path; UID: of its flash, 16 hexadecimal digits; STORAGE: a file that keeps the storage
// of its flash over a power cycle, from the first time that something is written there
import fs from 'node:fs';
import path from 'node:path';
import { LineIn } from './line.mjs';
import { Pico, bootRom } from './pico.mjs';
import { ROOT, bytes } from './words.mjs';

// Time that it may catch up at once, ns: beyond it the line would not be looked at.
const LONGEST_LAG = 5e6, STEP = 1e6;

const [image, uid, kept] = process.argv.slice(2);
const storage = kept && fs.existsSync(kept) ? fs.readFileSync(kept) : null;
const pico = new Pico({ image, bootRom: bootRom(path.join(ROOT, 'target/emulated/bootrom.bin')), uid: bytes(uid), storage });
const line = new LineIn(pico, pico.uarts[0]);
let said = [];
pico.uarts[0].onByte = (byte) => said.push(byte);
process.stdin.on('data', (chunk) => line.push(chunk));
process.stdin.on('end', () => process.exit(0));

// Flash operations that the file knows of.
let written = 0;

// The power may go at any moment: the file has all that the flash had after an operation.
function keep() {
  if (!kept || pico.nor.operations === written) return;
  written = pico.nor.operations;
  fs.writeFileSync(`${kept}.new`, pico.storage());
  fs.renameSync(`${kept}.new`, kept);
}

let wallBase = performance.now(), base = 0;

function target() {
  const now = performance.now(), wanted = base + (now - wallBase) * 1e6;
  if (wanted <= pico.now + LONGEST_LAG) return wanted;
  wallBase = now;
  base = pico.now + STEP;
  return base;
}

function turn() {
  const before = pico.instructions;
  pico.runUntil(target());
  keep();
  if (said.length) { fs.writeSync(1, Uint8Array.from(said)); said = []; }
  // An idle board leaves the processor to the others.
  if (pico.instructions === before) setTimeout(turn, 1);
  else setImmediate(turn);
}
turn();
