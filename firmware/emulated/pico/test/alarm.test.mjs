// Alarms of embassy's clock that are set when they are nearly due: a lost one would leave the node silent until a byte comes.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Board } from '../board.mjs';
import { kind } from '../line.mjs';
import { KIND, words } from '../words.mjs';

const TICKS = 2000, IMAGE = 'rp2040_pico', STATE = 0x13;
const WORDS = words('firmware/emulated/pair.toml', 'time.duration=20ms');
const [NODE] = WORDS.nodes;
const ALARM = 0x10, PERIOD_NS = 1e6, NEAR_US = 5;
// A wrong stop bit: after one, the node leaves its line alone for 1 ms (app/src/link/receiving.rs).
const FRAMING = 0x100;
// When such a byte comes, from when a state has left on, first and last: about when its tick, which a Pico begins 0.5 ms before that, was due. The pause ends just
// before the tick, and what is left of it is the next alarm.
const FIRST_NS = -650_000, LAST_NS = -350_000;

// A node by its own clock, and a pause at every second of its ticks, later from one to the next. `onAlarm` is told of each alarm that is set, in us from now, and says whether
// it is kept.
function ticks(count, onAlarm) {
  const board = Board.booted(IMAGE), { pico } = board;
  board.ask(NODE.configure_by_timer, KIND.configured);
  board.tell(WORDS.start.serial);
  board.ms(3);
  const states = () => board.said.filter(({ frame }) => kind(frame) === STATE);
  const timer = pico.chip.peripherals[0x40054], write = timer.writeUint32.bind(timer);
  timer.writeUint32 = (offset, value) => {
    write(offset, value);
    if (offset === ALARM && !onAlarm(value - pico.now / 1000)) timer.disarmAlarm(timer.alarms[0]);
  };
  const { at: begin } = states().at(-1);
  for (let tick = 1; tick <= count; tick++) {
    if (tick % 2) continue;
    pico.runUntil(begin + tick * PERIOD_NS + FIRST_NS + ((LAST_NS - FIRST_NS) * tick) / count);
    board.uart.feed(FRAMING);
  }
  pico.runUntil(begin + (count + 0.5) * PERIOD_NS);
  return { said: states().filter(({ at }) => at > begin).map(({ at }) => at - begin), resets: pico.resets };
}

const isEven = (said) => said.every((at, i) => Math.abs(at - (i + 1) * PERIOD_NS) < PERIOD_NS / 10);

test('no alarm is lost that is set just before it is due', () => {
  const near = new Map();
  const { said, resets } = ticks(TICKS, (ahead) => {
    const us = Math.floor(ahead);
    if (Math.abs(us) <= NEAR_US) near.set(us, (near.get(us) ?? 0) + 1);
    return true;
  });
  console.log(`# ${said.length} ticks; alarms by how far ahead they were set, us: ${[...near].sort(([a], [b]) => a - b).map(([us, times]) => `${us}: ${times}`).join(', ')}`);
  for (const ahead of [0, 1, 2, 3]) assert.ok(near.has(ahead), `no alarm was set ${ahead} us ahead: the test shows nothing`);
  assert.equal(said.length, TICKS);
  assert.ok(isEven(said));
  assert.equal(resets, 0);
});

test('one alarm that is lost is found out', () => {
  let lost = 0;
  const { said } = ticks(TICKS, (ahead) => !(ahead > 0 && ahead < NEAR_US && ++lost === 5));
  assert.ok(lost >= 5);
  assert.ok(said.length < TICKS || !isEven(said));
});
