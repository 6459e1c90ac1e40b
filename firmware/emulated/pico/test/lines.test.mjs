// A Pico's line to its host: what its pin does where nothing drives it, and errors.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Board } from '../board.mjs';
import { KIND, words } from '../words.mjs';

const WORDS = words('firmware/emulated/pair.toml', 'time.duration=5ms');
const IMAGE = 'rp2040_pico', HOST_RX = 1, PEER_RX = 5;
const PULL_DOWN = 1 << 2, PULL_UP = 1 << 3;
const BYTE_NS = 10_000, ROUNDS = 200;
// Bits that the UART gives with a byte, and its mask of interrupts with those of reception.
const ERRORS = { framing: 0x100, parity: 0x200, break: 0x400 }, MASK = 0x38, RECEPTION = 1 << 4 | 1 << 6;

const pulls = (board, pin) => board.pico.chip.gpio[pin].padValue & (PULL_DOWN | PULL_UP);

test('a line that nothing drives is pulled up', () => {
  for (const [image, ...pins] of [[IMAGE, HOST_RX], ['rp2040_pico_peers', HOST_RX, PEER_RX], ['heater', HOST_RX]]) {
    const board = Board.booted(image);
    for (const pin of pins) assert.equal(pulls(board, pin), PULL_UP, `${image}, GP${pin}`);
  }
});

function draws(seed) {
  let state = seed;
  return (below) => (state = (Math.imul(state, 1103515245) + 12345) >>> 0) % below;
}

// Errors at any moment of what the node does with its line, an overrun among them; whether it answers after each.
function answersAfterErrors(board) {
  const draw = draws(3), kinds = [...Object.values(ERRORS), 'overrun'];
  let answers = 0;
  for (let round = 0; round < ROUNDS; round++) {
    board.tell(WORDS.report);
    board.pico.runFor(draw(400 * BYTE_NS / 10));
    const error = kinds[round % kinds.length];
    // An overrun: more at one moment than there is room for.
    if (error === 'overrun') for (let i = 0; i < 40; i++) board.uart.feed(0);
    else board.uart.feed(error | draw(256));
    board.pico.runFor(draw(2e6));
    // The first byte after an overrun is lost, and what was cut off ends here.
    board.tell('0000');
    board.ms(2);
    if (!board.identity(WORDS)) break;
    answers++;
  }
  return answers;
}

test('after each of two hundred errors at any moment it hears again', () => {
  const board = Board.booted(IMAGE);
  assert.equal(answersAfterErrors(board), ROUNDS);
  assert.ok(board.uart.count.overruns > 0);
  assert.equal(board.pico.resets, 0);
});

test('one whose driver does not let reception go on after an error is found out', () => {
  const board = Board.booted(IMAGE), write = board.uart.writeUint32.bind(board.uart);
  board.uart.writeUint32 = (offset, value) => write(offset, offset === MASK && !(board.uart.imsc & RECEPTION) ? value & ~RECEPTION : value);
  assert.ok(answersAfterErrors(board) < ROUNDS);
});
