// The Pico's image with virtual state: start, storage, and what ends it.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Board } from '../board.mjs';
import { PowerCut } from '../nor.mjs';
import { kind } from '../line.mjs';
import { KIND, words } from '../words.mjs';

const IMAGE = 'rp2040_pico';
const WORDS = words('firmware/emulated/pair.toml', 'time.duration=5ms');
const [NODE] = WORDS.nodes;
const TICKS_AT_COMMIT = 60, LONGEST_COMMIT_MS = 9, STATE = 0x13;
const COMMIT = words('firmware/emulated/pair.toml', `time.duration=${TICKS_AT_COMMIT + 5}ms`);

// What was cut off of a frame ends here. The driver drops the first byte after an overrun, with which the UART tells of it.
const END = '0000';

function configured(board) {
  assert.deepEqual(board.ask(NODE.configure, KIND.configured), { configured: { ok: null }, source: NODE.id });
  return board;
}

function stored() {
  const board = configured(Board.booted(IMAGE));
  assert.equal(typeof board.ask(WORDS.store, KIND.stored).stored.ok, 'number');
  return board;
}

test('boots from its ROM and says who it is', () => {
  const board = Board.booted(IMAGE, { uid: [0xe6, 0x60, 0x58, 0x38, 0x83, 0x2b, 0x10, 7] });
  assert.equal(board.uart.baud, 1e6);
  const { id, uid, reset, starts } = board.identity(WORDS);
  // JSON has no such large integers; the last digits are rounded.
  assert.deepEqual({ id, reset, starts }, { id: 0, reset: 'PowerOn', starts: 1 });
  assert.equal(uid, Number(0xe6605838832b1007n));
});

test('keeps its configuration over a power cycle', () => {
  const after = stored().powerCycled(IMAGE).identity(WORDS);
  assert.deepEqual([after.id, after.checksum, after.reset], [NODE.id, NODE.checksum, 'PowerOn']);
  // The other world: one that was configured and not stored is blank.
  assert.equal(configured(Board.booted(IMAGE)).powerCycled(IMAGE).identity(WORDS).id, 0);
});

test('a cut at any flash operation of a commissioning leaves the old configuration or the new one', () => {
  const storage = stored().pico.storage();
  const ends = new Map();
  for (const depth of [0, 0.5, 1]) {
    for (let operation = 0; commissionedUntil(storage, { operation, depth }, ends); operation++);
  }
  const kinds = new Set([NODE.checksum, NODE.other_checksum]);
  const cuts = [...ends.values()].reduce((sum, count) => sum + count, 0);
  console.log(`# ${cuts} cuts: ${ends.get(NODE.checksum)} keep the old configuration, ${ends.get(NODE.other_checksum)} have the new one`);
  assert.ok(cuts >= 20, `only ${cuts} cuts`);
  assert.deepEqual(new Set(ends.keys()), kinds);
});

// Whether there was such an operation to be cut at.
function commissionedUntil(storage, cutAt, ends) {
  const board = Board.booted(IMAGE, { storage });
  board.pico.nor.operations = 0;
  board.pico.nor.cutAt = cutAt;
  try {
    board.ask(NODE.stage_other, KIND.staged);
    board.tell(WORDS.commit.serial);
    board.ms(300);
    return false;
  } catch (error) {
    if (!(error instanceof PowerCut)) throw error;
  }
  const identity = board.powerCycled(IMAGE).identity(WORDS);
  const end = identity && identity.id === NODE.id ? identity.checksum : 'blank or silent';
  ends.set(end, (ends.get(end) ?? 0) + 1);
  return true;
}

// Milliseconds between the states of a node by its own clock that changes, at a tick, to what it has staged; what it is then.
function committed({ isTold }) {
  const board = Board.booted(IMAGE), { ticks, commit_at, commit_at_tick } = COMMIT;
  board.ask(COMMIT.nodes[0].configure_by_timer, KIND.configured);
  board.ask(COMMIT.nodes[0].stage_other_by_timer, KIND.staged);
  board.tell(WORDS.start.serial);
  const begin = board.pico.now;
  for (let tick = 0; tick < TICKS_AT_COMMIT; tick++) {
    board.pico.runUntil(begin + tick * 1e6);
    board.tell(ticks[tick + 1].states[1][0].serial);
    if (isTold && tick === commit_at_tick - 10) board.tell(commit_at.serial);
  }
  const times = board.said.filter(({ at, frame }) => at > begin && kind(frame) === STATE).map(({ at }) => at / 1e6);
  const gaps = times.slice(1).map((at, i) => at - times[i]), { counters } = board.ask(WORDS.report, KIND.report).report;
  return { longest: Math.max(...gaps.slice(1)), count: times.length, late: counters.overruns, checksum: board.identity(WORDS).checksum };
}

test('a commit on a node that runs stands still for some ticks of 1 ms, and the node goes on', () => {
  const { longest, count, late, checksum } = committed({ isTold: true });
  console.log(`# ${IMAGE}: a commit at a tick of 1 ms: ${longest.toFixed(2)} ms between two states, ${TICKS_AT_COMMIT - count} of ${TICKS_AT_COMMIT} ticks without one, ${late} counted as late`);
  assert.equal(checksum, COMMIT.nodes[0].other_by_timer_checksum);
  assert.ok(longest > 2 && longest < LONGEST_COMMIT_MS, `${longest} ms`);
  const other = committed({ isTold: false });
  assert.ok(other.longest < 1.1, `${other.longest} ms without a commit`);
  assert.notEqual(other.checksum, checksum);
});

test('a program that hangs is reset by its watchdog after two seconds, and says so', () => {
  const board = Board.booted(IMAGE);
  const begin = board.pico.now;
  let after = null;
  board.pico.onReset = () => { after = (board.pico.now - begin) / 1e6; };
  board.pico.hang();
  board.ms(2500);
  assert.ok(after > 1400 && after <= 2010, `reset after ${after} ms`);
  const { reset, starts } = board.identity(WORDS);
  assert.deepEqual({ reset, starts }, { reset: 'Watchdog', starts: 2 });
});

test('its watchdog goes on while a debugger holds the core', () => {
  const { pauseDbg0, pauseDbg1, pauseJtag, enable } = Board.booted(IMAGE).pico.watchdog;
  assert.deepEqual({ pauseDbg0, pauseDbg1, pauseJtag, enable }, { pauseDbg0: false, pauseDbg1: false, pauseJtag: false, enable: true });
});

test('a debugger that was unplugged holds up nothing', () => {
  const board = configured(Board.booted(IMAGE));
  board.pico.leaveDebugger();
  const before = board.pico.logWords();
  board.tell(WORDS.start.serial);
  board.ms(5);
  assert.notDeepEqual(board.pico.logWords(), before, 'nothing was logged: the test shows nothing');
  assert.equal(board.identity(WORDS).id, NODE.id);
  board.ms(3000);
  assert.equal(board.pico.resets, 0);
});

test('a node that idles is never reset', () => {
  const board = Board.booted(IMAGE);
  board.ms(10_000);
  assert.equal(board.pico.resets, 0);
});

test('a hard fault resets it at once, and it says so', () => {
  const board = Board.booted(IMAGE);
  board.pico.fault();
  board.ms(50);
  assert.equal(board.pico.resets, 1);
  const { reset, starts } = board.identity(WORDS);
  assert.deepEqual({ reset, starts }, { reset: 'HardFault', starts: 2 });
});

test('a full line while it stores costs frames and nothing else', () => {
  const board = configured(Board.booted(IMAGE));
  const [, other] = WORDS.ticks[1].states, state = other[0].serial;
  board.tell(WORDS.store);
  for (let i = 0; i < 1200; i++) board.tell(state);
  board.ms(400);
  board.tell(END);
  assert.ok(board.uart.count.overruns > 0, 'nothing was lost: the test shows nothing');
  assert.equal(board.identity(WORDS).id, NODE.id);
  assert.equal(board.pico.resets, 0);
});

test('sixty thousand bytes of noise with line errors leave a node that answers', () => {
  const board = configured(Board.booted(IMAGE));
  let seed = 12345;
  const random = () => (seed = (Math.imul(seed, 1103515245) + 12345) >>> 0) >>> 8;
  for (let i = 0; i < 60_000; i++) {
    const error = random() % 50 === 0 ? 0x100 << random() % 3 : 0;
    board.uart.feed((random() & 0xff) | error);
    board.ms(0.01);
  }
  // Each error costs a pause of 1 ms (app/src/link/receiving.rs); what waits is read first.
  board.ms(200);
  board.tell(END);
  assert.equal(board.identity(WORDS).id, NODE.id);
  assert.equal(board.pico.resets, 0);
});
