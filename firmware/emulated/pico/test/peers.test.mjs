// Two Picos with a serial line to each other, in one process and one time.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Board } from '../board.mjs';
import { Frames, LineIn, kind } from '../line.mjs';
import { KIND, words } from '../words.mjs';

const WORDS = words('firmware/emulated/pair.toml', 'time.duration=100ms');
const BYTE_NS = 10_000, TICK_NS = 1e6, STATE = 0x13;
// Bits that the UART gives with a byte.
const ERROR = { framing: 0x100, parity: 0x200, break: 0x400 };

// Boards whose second UARTs are wired to each other; `said` is what each says on the wire.
class Pair {
  constructor() {
    this.boards = [1, 2].map((number) => Board.booted('rp2040_pico_peers', { uid: [0, 0, 0, 0, 0, 0, 0, number] }));
    this.said = [[], []];
    const wires = this.boards.map((board) => new LineIn(board.pico, board.pico.uarts[1]));
    this.boards.forEach((board, i) => {
      const frames = new Frames((frame) => this.said[i].push(frame));
      board.pico.uarts[1].onByte = (byte) => { frames.push(byte); wires[1 - i].push([byte]); };
    });
  }

  // Both go on by a byte at a time, so that none is ahead of what the other says.
  run(nanos) {
    const start = Math.max(...this.boards.map((board) => board.pico.now));
    for (let at = start + BYTE_NS; at <= start + nanos; at += BYTE_NS) this.boards.forEach((board) => board.pico.runUntil(at));
  }
}

test('two Picos on a line to each other run the bits of loopback', () => {
  const pair = new Pair();
  pair.boards.forEach((board, i) => assert.deepEqual(board.ask(WORDS.nodes[i].configure, KIND.configured).configured, { ok: null }));
  pair.said.forEach((said) => { said.length = 0; });
  pair.boards.forEach((board) => board.tell(WORDS.start.serial));
  pair.run(TICK_NS);
  for (const { sync } of WORDS.ticks.slice(0, -1)) {
    pair.boards.forEach((board) => board.tell(sync.serial));
    pair.run(TICK_NS);
  }
  pair.said.forEach((said, i) => {
    const states = said.filter((frame) => kind(frame) === STATE).map((frame) => `${Buffer.from(frame).toString('hex')}00`);
    assert.deepEqual(states, WORDS.ticks.map((tick) => tick.states[i][0].serial));
  });
});

test('errors on either of its lines are counted, and it goes on', () => {
  const board = Board.booted('rp2040_pico_peers');
  assert.deepEqual(board.ask(WORDS.nodes[0].configure, KIND.configured).configured, { ok: null });
  const counted = () => board.ask(WORDS.report, KIND.report).report.counters.link.line_errors;
  let errors = counted();
  assert.equal(errors, 0);
  for (const uart of board.pico.uarts) {
    for (const error of [ERROR.framing, ERROR.parity, ERROR.break]) {
      uart.feed(error);
      board.ms(5);
      board.tell('00');
      assert.equal(counted(), ++errors);
    }
  }
  assert.equal(board.pico.resets, 0);
});
