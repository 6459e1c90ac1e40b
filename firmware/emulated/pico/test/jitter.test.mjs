// How even the states of a Pico are with traffic on its line, as far as cycles of the emulator tell: after a SYNC, and by its own clock.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Board } from '../board.mjs';
import { kind } from '../line.mjs';
import { KIND, words } from '../words.mjs';

const TICKS = process.env.FUNNEL_EXTENDED === '1' ? 10_000 : 300;
const SPARE = 10, IMAGE = 'rp2040_pico';
const WORDS = words('firmware/emulated/pair.toml', `time.duration=${TICKS + SPARE}ms`);
const [NODE] = WORDS.nodes;
const STRANGERS = words('scenarios/five-agents.toml', 'time.duration=10ms').ticks.flatMap(({ states }) => states.slice(2).map(([state]) => state.serial));
const MS = 1e6, BYTE_NS = 10_000, PERIOD_US = 1000, LARGEST = 0.05, STATE = 0x13;

const width = (times) => Math.max(...times) - Math.min(...times);
const isState = ({ frame }) => kind(frame) === STATE;

test('the state follows the SYNC with a jitter of less than 5 % of the period', () => {
  const board = Board.booted(IMAGE);
  board.ask(NODE.configure, KIND.configured);
  board.tell(WORDS.start.serial);
  board.ms(1);
  const delays = WORDS.ticks.slice(0, TICKS).map(({ sync, states: [, [other]] }) => {
    const from = board.said.length, begin = board.pico.now;
    board.tell(other.serial);
    board.tell(sync.serial);
    board.ms(1);
    const answers = board.said.slice(from).filter(isState);
    assert.equal(answers.length, 1);
    return (answers[0].at - begin) / 1000;
  });
  const [least, most] = [Math.min(...delays), Math.max(...delays)];
  console.log(`# ${IMAGE}: ${delays.length} ticks, state ${least.toFixed(1)} to ${most.toFixed(1)} us after the first byte of neighbour and SYNC`);
  assert.ok(most - least < LARGEST * PERIOD_US, `jitter ${(most - least).toFixed(1)} us`);
});

// Numbers from 0 to below 1, the same in every run.
function draws(seed) {
  let state = seed;
  return () => (state = (Math.imul(state, 1103515245) + 12345) >>> 0) / 2 ** 32;
}

// A frame of drawn bytes, as hexadecimal digits.
function noise(draw) {
  const drawn = Array.from({ length: 2 + Math.floor(draw() * 28) }, () => 1 + Math.floor(draw() * 255));
  return `${Buffer.from(drawn).toString('hex')}00`;
}

// Runs a node by its own clock among states of its neighbour, states of strangers and noise; how far its states are from an even row, us.
function late(ticks, at = () => {}) {
  const board = Board.booted(IMAGE), draw = draws(7);
  board.ask(NODE.configure_by_timer, KIND.configured);
  board.tell(WORDS.start.serial);
  const begin = board.pico.now;
  // The start is one, too.
  let told = 1;
  const tell = (frame) => { board.tell(frame); told++; };
  for (let tick = 0; tick < ticks; tick++) {
    at(tick, board);
    board.pico.runUntil(begin + (tick + draw() * 0.3) * MS);
    tell(WORDS.ticks[tick + 1].states[1][0].serial);
    while (board.pico.now < begin + (tick + 0.8) * MS) {
      const other = draw() < 0.5 ? STRANGERS[Math.floor(draw() * STRANGERS.length)] : noise(draw);
      tell(other);
      board.pico.runFor((other.length / 2) * BYTE_NS);
    }
  }
  board.pico.runUntil(begin + ticks * MS);
  // Without the one that is announced at the start.
  const [, ...times] = board.said.filter((each) => each.at > begin && isState(each)).map((each) => each.at / 1000);
  const { counters } = board.ask(WORDS.report, KIND.report).report;
  return { late: times.map((time, index) => time - index * PERIOD_US), told, counters, lost: board.uart.count.overruns };
}

test('by its own clock its states are even with traffic', () => {
  const { late: row, told, counters, lost } = late(TICKS);
  const heard = counters.accepted + counters.refused.reduce((sum, each) => sum + each);
  console.log(`# ${IMAGE}: ${row.length} ticks by its own clock, ${told} frames on its line, ${counters.accepted} accepted, jitter ${width(row).toFixed(1)} us`);
  assert.ok(row.length >= TICKS - 2);
  assert.deepEqual([heard, counters.overruns, counters.link.line_errors, lost], [told, 0, 0, 0]);
  assert.ok(width(row) < LARGEST * PERIOD_US, `jitter ${width(row).toFixed(1)} us`);
});

test('a core that stands still once is seen in the row of its states', () => {
  const { late: row } = late(20, (tick, { pico }) => { if (tick === 10) pico.clock.tick(1.5 * MS); });
  assert.ok(width(row) > LARGEST * PERIOD_US, `jitter ${width(row).toFixed(1)} us`);
});
