// The heater on a Pico: what its pin does.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Board } from '../board.mjs';
import { connectSensor, duty as dutyOf } from '../pins.mjs';
import { KIND, words } from '../words.mjs';

const WORDS = words('firmware/heaters.toml', 'time.duration=1s');
// What the sensor gives at 30 degrees C: (celsius + 50) / (330 / 4096).
const COUNTS = 993;

const duty = (board) => dutyOf(board.pico);

function heating() {
  const board = Board.booted('heater');
  connectSensor(board.pico, () => COUNTS);
  assert.equal(duty(board), 0);
  const [node] = WORDS.nodes;
  assert.deepEqual(board.ask(node.configure, KIND.configured).configured, { ok: null });
  board.tell(WORDS.start.serial);
  board.ms(2);
  board.tell(WORDS.ticks[0].sync.serial);
  board.ms(5);
  assert.ok(duty(board) > 0.05, `it heats: ${duty(board)}`);
  return board;
}

test('it says the number of its flash', () => {
  const numbers = [[1, 2, 3, 4, 5, 6, 7, 8], [0, 0, 0, 0, 0, 0, 0, 9]];
  assert.deepEqual(numbers.map((uid) => Board.booted('heater', { uid }).identity(WORDS).uid), [Number(0x0102030405060708n), 9]);
});

test('a stop makes the output safe', () => {
  const board = heating();
  board.tell(WORDS.stop.serial);
  board.ms(2);
  assert.equal(duty(board), 0);
});

test('a hard fault makes the output safe before the reset, and it stays so after it', () => {
  const board = heating();
  let before = null;
  board.pico.onReset = () => { before = duty(board); };
  board.pico.fault();
  board.ms(50);
  assert.equal(before, 0);
  assert.equal(duty(board), 0);
  assert.equal(board.identity(WORDS).reset, 'HardFault');
});

test('a program that hangs keeps its output until its watchdog resets it, two seconds at most', () => {
  const board = heating();
  const wanted = duty(board), begin = board.pico.now;
  let before = null, after = null;
  board.pico.onReset = () => { before = duty(board); after = (board.pico.now - begin) / 1e9; };
  board.pico.hang();
  board.ms(2500);
  assert.equal(before, wanted, 'docs/book/src/safety.md, "What is not covered"');
  assert.ok(after <= 2.01, `${after} s`);
  assert.equal(duty(board), 0);
});
