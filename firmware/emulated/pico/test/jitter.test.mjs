// How evenly a Pico answers a SYNC, with a neighbour's states on its line: the tick's jitter, as far as cycles of the emulator tell.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Board } from '../board.mjs';
import { kind } from '../line.mjs';
import { KIND, words } from '../words.mjs';

const TICKS = process.env.FUNNEL_EXTENDED === '1' ? 10_000 : 300;
const WORDS = words('firmware/emulated/pair.toml', `time.duration=${TICKS}ms`);
const [NODE] = WORDS.nodes;
// The worst of 10,000 ticks is at 5.2 %, so that the extended mode fails here (boards.md).
const PERIOD_US = 1000, LARGEST = 0.05, STATE = 0x13;

test('the state follows the SYNC with a jitter of less than 5 % of the period', () => {
  const board = Board.booted('rp2040_pico');
  board.ask(NODE.configure, KIND.configured);
  board.tell(WORDS.start.serial);
  board.ms(1);
  const delays = WORDS.ticks.slice(0, -1).map(({ sync, states: [, [other]] }) => {
    const from = board.said.length, begin = board.pico.now;
    board.tell(other.serial);
    board.tell(sync.serial);
    board.ms(1);
    const answers = board.said.slice(from).filter(({ frame }) => kind(frame) === STATE);
    assert.equal(answers.length, 1);
    return (answers[0].at - begin) / 1000;
  });
  const [least, most] = [Math.min(...delays), Math.max(...delays)];
  console.log(`# rp2040_pico: ${delays.length} ticks, state ${least.toFixed(1)} to ${most.toFixed(1)} us after the first byte of neighbour and SYNC`);
  assert.ok(most - least < LARGEST * PERIOD_US, `jitter ${(most - least).toFixed(1)} us`);
});
