// One Pico that takes updates behind standard input and output: its boot loader and its program, as they are flashed at the workbench.
//
// usage: serve-update.mjs BOOT PROGRAM UID REPORT [hangs]      BOOT, PROGRAM: paths of ELF files; UID: of its flash, 16 hexadecimal digits; REPORT: a file that says at the
// end what its flash holds: checksums of as many bytes as OLD_LENGTH and NEW_LENGTH say. With `hangs` a program on trial hangs as soon as it begins, and the watchdog has to take it back.
import fs from 'node:fs';
import path from 'node:path';
import { Elf } from './elf.mjs';
import { pico, serve } from './served.mjs';
import { bytes, crc32 } from './words.mjs';

const FLASH = 0x10000000, ACTIVE = { start: 0x10008000, end: 0x10048000 }, STATE = 0x10007000 - FLASH, SWAP_MAGIC = 0xf0;

const [boot, program, uid, report, flaw] = process.argv.slice(2);
const board = pico({ image: path.resolve(boot), uid: bytes(uid) });
const { chip } = board;
for (const { address, bytes: part } of new Elf(path.resolve(program)).segments()) chip.flash.set(part, address - FLASH);
board.powerOn();

const crc = (length) => crc32(chip.flash.subarray(ACTIVE.start - FLASH, ACTIVE.start - FLASH + length));
// The boot loader has told itself to swap, and nothing has confirmed that.
const isOnTrial = () => chip.flash[STATE] === SWAP_MAGIC && chip.flash[STATE + 8] === 0xff;
const runsProgram = () => chip.core.PC >= ACTIVE.start && chip.core.PC < ACTIVE.end;
const { OLD_LENGTH, NEW_LENGTH } = process.env;
let hung = false;

// The first restart is the one into the new program.
function afterTurn() {
  if (flaw !== 'hangs' || hung || board.resets !== 1 || !runsProgram()) return;
  board.hang();
  hung = true;
}

process.on('SIGTERM', () => {
  fs.writeFileSync(report, JSON.stringify({ resets: board.resets, on_trial: isOnTrial(), old: crc(Number(OLD_LENGTH)), new: crc(Number(NEW_LENGTH)) }));
  process.exit(0);
});
serve(board, { afterTurn });
