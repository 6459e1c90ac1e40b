// A Pico with a boot loader takes a new program over its line, runs it on trial, keeps it or goes back. ./ci.sh update
import assert from 'node:assert/strict';
import path from 'node:path';
import { test } from 'node:test';
import { Board, IMAGES } from '../board.mjs';
import { Elf } from '../elf.mjs';
import { kind } from '../line.mjs';
import { PowerCut } from '../nor.mjs';
import { KIND, crc32, words } from '../words.mjs';
import { UPDATED, answer, request } from './wire.mjs';

const FLASH = 0x10000000, ACTIVE = 0x10008000 - FLASH, ROOM = 256 << 10, SPARE = 0x10048000 - FLASH;
const BLOCK = 256, TRIAL_TICKS = 100, MS = 1e6;
const BOARD = crc32(Buffer.from('rp2040-pico'));
const WORDS = words('firmware/emulated/pair.toml', 'time.duration=150ms');
const [NODE] = WORDS.nodes;
// Of a swap: 64 sectors, two erases and 32 programs each.
const SWAP_MS = 15_000, BOOT_MS = 200;
// Operations of the swap at which the power fails, and how much of them is done: an erase, programs, marks of pages.
const CUTS = [[0, 0.5], [9, 0.5], [1_111, 1], [2_290, 0.3]];
const BRANCH_TO_ITSELF = [0xfe, 0xe7];

// What is flashed at the program's place, as one piece.
function program(image) {
  const parts = new Elf(path.join(IMAGES, image)).segments();
  const end = Math.max(...parts.map(({ address, bytes }) => address + bytes.length)) - FLASH;
  const bytes = Buffer.alloc(end - ACTIVE, 0xff);
  for (const part of parts) part.bytes.copy(bytes, part.address - FLASH - ACTIVE);
  return bytes;
}

const OLD = program('rp2040_pico_update');
// The same with a word more: another program, to the bit.
const NEW = Buffer.concat([OLD, Buffer.from('new!')]);
// Its first instruction leads to itself.
const BAD = Buffer.from(NEW);
BRANCH_TO_ITSELF.forEach((byte, i) => { BAD[(OLD.readUInt32LE(4) & ~1) - FLASH - ACTIVE + i] = byte; });

class Updated extends Board {
  // With this flash, or as it comes from the workbench: boot loader and old program.
  constructor(flash = null) {
    super('rp2040_pico_boot');
    const { chip } = this.pico;
    if (flash) chip.flash.set(flash);
    else chip.flash.set(OLD, ACTIVE);
    this.pico.powerOn();
  }

  static started(flash) {
    const board = new Updated(flash);
    board.ms(BOOT_MS);
    return board;
  }

  get flash() { return this.pico.chip.flash.slice(0, 2 << 20); }

  // Asks, and waits for the answer.
  say(frame, withinMs = 2_000) {
    const from = this.said.length, end = this.pico.now + withinMs * MS;
    this.line.push(frame);
    while (this.pico.now < end) {
      this.pico.runFor(100_000);
      const found = this.said.slice(from).find(({ frame: said }) => kind(said) === UPDATED);
      if (found) return answer(found.frame);
    }
    return null;
  }

  status(of) { return this.say(request.status(of.length)).status; }

  runs(of) { return this.status(of).crc === crc32(of); }

  send(image) {
    assert.deepEqual(this.say(request.begin({ board: BOARD, length: image.length, crc: crc32(image) })), { ok: null });
    for (let at = 0; at < image.length; at += BLOCK) {
      const bytes = image.subarray(at, at + BLOCK);
      assert.deepEqual(this.say(request.block(at, bytes)), { ok: Math.min(at + BLOCK, image.length) });
    }
    assert.deepEqual(this.say(request.check()), { ok: null });
  }

  store() {
    assert.deepEqual(this.ask(NODE.configure, KIND.configured), { configured: { ok: null }, source: NODE.id });
    assert.equal(typeof this.ask(WORDS.store, KIND.stored).stored.ok, 'number');
  }
}

function stored() {
  const board = Updated.started();
  board.store();
  return board;
}

test('the boot loader starts a program that says who it is, and is not on trial', () => {
  const board = Updated.started();
  assert.equal(board.identity(WORDS).reset, 'PowerOn');
  const status = board.status(OLD);
  assert.deepEqual([status.board, status.room, status.crc, status.onTrial], [BOARD, ROOM, crc32(OLD), false]);
});

// Made when it is first asked for.
function once(make) {
  let made = null;
  return () => (made ??= make());
}

// A flash whose next start swaps; operations of the flash until then are not counted.
const beforeSwap = once(() => {
  const board = stored();
  board.send(NEW);
  assert.deepEqual(board.say(request.swap()), { ok: null });
  return board.flash;
});

const swapped = once(() => {
  const board = new Updated(beforeSwap());
  board.ms(SWAP_MS);
  assert.ok(board.runs(NEW) && board.status(NEW).onTrial);
  assert.equal(board.identity(WORDS).checksum, NODE.checksum, 'the configuration is kept');
  return board.flash;
});

// What runs after a start, with time to swap; the configuration has to be there.
function runsAfter(flash) {
  const board = new Updated(flash);
  board.ms(SWAP_MS);
  assert.equal(board.identity(WORDS)?.checksum, NODE.checksum, 'the configuration is kept');
  const { crc } = board.status(NEW);
  if (crc === crc32(NEW)) return 'new';
  return board.runs(OLD) ? 'old' : 'neither';
}

test('a new program is swapped in, is on trial, and goes back unless it ticks', () => {
  assert.equal(runsAfter(swapped()), 'old');
});

test('a new program that has completed its ticks stays', () => {
  const board = new Updated(beforeSwap());
  board.ms(SWAP_MS);
  assert.deepEqual([board.runs(NEW), board.status(NEW).ticksLeft], [true, TRIAL_TICKS]);
  board.ask(NODE.configure_by_timer, KIND.configured);
  board.tell(WORDS.start.serial);
  const begin = board.pico.now;
  for (let tick = 0; tick < TRIAL_TICKS + 20; tick++) {
    board.pico.runUntil(begin + tick * MS);
    board.tell(WORDS.ticks[tick + 1].states[1][0].serial);
  }
  assert.deepEqual(board.say(request.check()), { error: 'running' }, 'a node that runs is left alone');
  board.tell(WORDS.stop.serial);
  board.ms(5);
  assert.ok(!board.status(NEW).onTrial);
  assert.equal(runsAfter(board.flash), 'new');
});

test('a program that hangs before it is a node is reset by the watchdog, and goes back', () => {
  const flash = beforeSwap().slice();
  flash.set(BAD, SPARE);
  const hung = new Updated(flash);
  // Swap, 8 s of the watchdog, and the way back.
  hung.ms(2 * SWAP_MS + 9_000);
  assert.ok(hung.runs(OLD));
  assert.equal(hung.identity(WORDS).checksum, NODE.checksum);
});

test('a cut at operations of the swap leaves one of the two, whole', () => {
  const ends = [];
  for (const [operation, depth] of CUTS) {
    const board = new Updated(beforeSwap());
    board.pico.nor.operations = 0;
    board.pico.nor.cutAt = { operation, depth };
    assert.throws(() => board.ms(SWAP_MS), PowerCut);
    ends.push(runsAfter(board.flash));
  }
  console.log(`# cuts at ${CUTS.map(([operation]) => operation).join(', ')}: ${ends.join(', ')}`);
  assert.deepEqual(new Set(ends), new Set(['new']), 'the swap goes on where it was cut off');
});
