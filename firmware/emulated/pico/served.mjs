// A Pico behind standard input and output. Its time goes no faster than the wall clock; where it is slower, it lags.
import path from 'node:path';
import fs from 'node:fs';
import { SerialPort } from './cdc.mjs';
import { LineIn } from './line.mjs';
import { Pico, bootRom } from './pico.mjs';
import { ROOT, bytes } from './words.mjs';

// Time that it may catch up at once, ns: beyond it the line would not be looked at.
const LONGEST_LAG = 5e6, STEP = 1e6;

// A Pico with this image, its line at standard input and output once it is served.
export const pico = (options) => new Pico({ bootRom: bootRom(path.join(ROOT, 'target/emulated/bootrom.bin')), ...options });

// Runs it until standard input ends, with its UART or its port over USB; calls `afterTurn` whenever it has run for a while, before what it has said goes out.
export function serve(board, { afterTurn = () => {}, usb = false } = {}) {
  const line = usb ? new SerialPort(board) : new LineIn(board, board.uarts[0]);
  let said = [];
  board.uarts[0].onByte = (byte) => said.push(byte);
  if (usb) line.onData = (bytes) => said.push(...bytes);
  process.stdin.on('data', (chunk) => line.push(chunk));
  process.stdin.on('end', () => process.exit(0));
  let wallBase = performance.now(), base = 0;

  function target() {
    const now = performance.now(), wanted = base + (now - wallBase) * 1e6;
    if (wanted <= board.now + LONGEST_LAG) return wanted;
    wallBase = now;
    base = board.now + STEP;
    return base;
  }

  function turn() {
    const before = board.instructions;
    board.runUntil(target());
    afterTurn();
    if (said.length) { fs.writeSync(1, Uint8Array.from(said)); said = []; }
    // An idle board leaves the processor to the others.
    if (board.instructions === before) setTimeout(turn, 1);
    else setImmediate(turn);
  }
  turn();
}

// The Pico of a command line, IMAGE UID [STORAGE]. IMAGE: a path; UID: of its flash, 16 hexadecimal digits; STORAGE: a file that keeps the storage of its flash over a
// power cycle, from the first time that something is written there.
export function serveKept({ usb }) {
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

  serve(board, { afterTurn: keep, usb });
}
