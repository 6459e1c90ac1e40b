// The Pico's image with its line over USB: the bits of loopback, and hosts that do not read, are unplugged or send noise.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Board } from '../board.mjs';
import { kind } from '../line.mjs';
import { KIND, bytes, words } from '../words.mjs';

const IMAGE = 'rp2040_pico_usb', MS = 1e6, PACKET = 64, STATE = 0x13;
const WORDS = words('firmware/emulated/pair.toml', 'time.duration=300ms');
const [NODE] = WORDS.nodes;
// Whatever was cut off ends here.
const END = '00';

const booted = (options) => Board.booted(IMAGE, { ...options, usb: true });
const isState = ({ frame }) => kind(frame) === STATE;
const isRealTime = ({ frame }) => kind(frame) < 0x40;
const hex = ({ frame }) => `${Buffer.from(frame).toString('hex')}00`;
const counters = (board) => board.ask(WORDS.report, KIND.report).report.counters;

function configured(how = 'configure') {
  const board = booted();
  assert.deepEqual(board.ask(NODE[how], KIND.configured).configured, { ok: null });
  return board;
}

// A node that ticks by its own clock, 1 ms.
function running() {
  const board = configured('configure_by_timer');
  board.tell(WORDS.start.serial);
  board.ms(50);
  return board;
}

test('is a serial port whose serial number is the number of its flash', () => {
  const board = booted({ uid: [0xe6, 0x60, 0x58, 0x38, 0x83, 0x2b, 0x10, 7] });
  assert.equal(board.port.serialNumber, 'e6605838832b1007');
  const { device } = board.port.host.descriptors;
  assert.deepEqual([device[8] | device[9] << 8, device[10] | device[11] << 8], [0x1209, 0x0001]);
  // JSON has no such large integers; the last digits are rounded.
  assert.equal(board.identity(WORDS).uid, Number(0xe6605838832b1007n));
});

test('runs the bits of loopback', () => {
  const board = configured();
  board.tell(WORDS.start.serial);
  board.ms(2);
  for (const { sync, states: [, [other]] } of WORDS.ticks.slice(0, -1)) {
    board.tell(other.serial);
    board.tell(sync.serial);
    board.ms(2);
  }
  assert.deepEqual(board.said.filter(isState).map(hex), WORDS.ticks.map((tick) => tick.states[0][0].serial));
  assert.equal(board.port.host.count.toggleErrors, 0);
});

// Asks for so many identities at once; how many come.
function identities(board, count) {
  const from = board.said.length;
  board.tell(WORDS.hello.repeat(count));
  board.ms(20);
  return board.said.slice(from).filter(({ frame }) => kind(frame) === KIND.identity).length;
}

test('frames share packets, and a transfer that ends with a full packet is ended by an empty one', () => {
  const board = configured(), { count } = board.port;
  board.identity(WORDS);
  const { length } = board.said.at(-1).frame, begin = count.packets;
  assert.equal(identities(board, 6), 6);
  const packets = count.packets - begin;
  assert.ok(packets <= Math.ceil(6 * (length + 1) / PACKET) + 1, `${packets} packets`);
  const full = [...Array(PACKET).keys()].map((i) => i + 1).find((frames) => frames * (length + 1) % PACKET === 0);
  const before = count.empty;
  assert.equal(identities(board, full), full);
  assert.ok(count.empty > before, 'no empty packet');
});

test('without the empty packet a computer would keep the last answer to itself', () => {
  const board = configured();
  board.identity(WORDS);
  const { length } = board.said.at(-1).frame;
  const full = [...Array(PACKET).keys()].map((i) => i + 1).find((frames) => frames * (length + 1) % PACKET === 0);
  board.port.hearsEmpty = false;
  assert.ok(identities(board, full) < full);
});

// What the node has sent of the real-time plane up to its report, and what became of it.
function account(board, from = 0) {
  const { ticks, sent, overruns, link } = counters(board);
  const report = board.said.findLastIndex(({ frame }) => kind(frame) === KIND.report);
  return { heard: board.said.slice(from, report).filter(isRealTime).length, ticks, sent, overruns, unsaid: link.unsaid };
}

test('a host that does not read holds up no tick, and every frame that it misses is counted', () => {
  const board = running();
  board.port.isReading = false;
  board.ms(3000);
  board.port.resume();
  board.ms(50);
  const { heard, sent, ticks, overruns, unsaid } = account(board);
  console.log(`# ${ticks} ticks: ${sent} frames sent, ${heard} heard, ${unsaid} unsaid, ${overruns} overruns`);
  assert.ok(ticks >= 3095, `${ticks} ticks`);
  assert.equal(overruns, 0);
  assert.ok(unsaid > 2800, `${unsaid} unsaid: the host has read, the test shows nothing`);
  assert.equal(sent, heard + unsaid);
  assert.equal(board.pico.resets, 0);
});

test('who opens the port hears nothing that was said before, but for a packet', () => {
  const board = running();
  board.port.close();
  board.ms(500);
  const from = board.said.length;
  board.port.open();
  board.ms(20);
  const ticks = board.said.slice(from).filter(isState).map(({ frame }) => frame);
  // Those of the packet are old: 64 bytes, five frames of 12.
  assert.ok(ticks.length >= 18 && ticks.length <= 20 + Math.floor(PACKET / 12), `${ticks.length} states`);
  const { heard, sent, unsaid } = account(board);
  assert.ok(unsaid >= 490 && unsaid <= 505, `${unsaid} unsaid`);
  assert.equal(sent, heard + unsaid);
});

test('a host that opens the port again and again and reads nothing has missed as many frames as there were', () => {
  const board = running();
  board.port.isReading = false;
  for (let time = 0; time < 6; time += 1) {
    board.port.close();
    board.ms(50);
    board.port.open();
    board.ms(time);
  }
  board.port.resume();
  board.ms(50);
  const { heard, sent, unsaid } = account(board);
  assert.ok(unsaid >= 250, `${unsaid} unsaid`);
  assert.equal(sent, heard + unsaid);
});

test('a cable that is pulled in the middle of a frame and put back costs what was on its way', () => {
  const board = running(), { host } = board.port;
  const refused = () => counters(board).refused.reduce((sum, each) => sum + each);
  const before = refused(), state = bytes(WORDS.ticks[1].states[1][0].serial);
  board.port.push(state.slice(0, 6));
  board.ms(0.2);
  host.unplug();
  board.ms(1000);
  const from = board.said.length;
  assert.equal(board.said.filter(({ at }) => at > board.pico.now - 990 * MS).length, 0, 'the cable is still there');
  host.plug();
  board.ms(200);
  board.tell(END);
  const { heard, sent, unsaid, overruns, ticks } = account(board);
  const lost = sent - heard - unsaid;
  console.log(`# a pulled cable: ${sent} frames sent, ${heard} heard, ${unsaid} unsaid, ${lost} lost in the controller`);
  assert.deepEqual([host.count.enumerations, overruns, board.pico.resets], [2, 0, 0]);
  assert.ok(ticks >= 1250 && board.said.slice(from).length > 50, `${ticks} ticks`);
  // Two packets of frames of 12 bytes, and the ends of those that were cut.
  assert.ok(lost >= 0 && lost <= 2 * PACKET / 12 + 2, `${lost} lost`);
  assert.equal(refused(), before + 1);
  assert.equal(board.identity(WORDS).id, NODE.id);
});

test('sixty thousand bytes of noise leave a node that answers', () => {
  const board = configured();
  let seed = 12345;
  const random = () => (seed = (Math.imul(seed, 1103515245) + 12345) >>> 0) >>> 8;
  for (let i = 0; i < 60_000 / 40; i++) {
    board.port.push(Array.from({ length: 40 }, () => random() & 0xff));
    board.ms(1);
  }
  board.ms(200);
  board.tell(END);
  assert.equal(board.identity(WORDS).id, NODE.id);
  assert.ok(counters(board).refused.reduce((sum, each) => sum + each) > 100);
  assert.equal(board.pico.resets, 0);
});

test('a host that sends more than the node can take has to wait, and nothing of it is lost, not even while it stores', () => {
  const board = configured(), frames = 1200;
  const [, other] = WORDS.ticks[1].states, state = other[0].serial;
  board.tell(WORDS.store);
  for (let i = 0; i < frames; i++) board.tell(state);
  board.ms(20);
  assert.ok(board.port.queue.length > 0, 'it did not have to wait: the test shows nothing');
  board.ms(1500);
  assert.equal(board.port.queue.length, 0);
  const { accepted, late, refused } = counters(board);
  assert.equal(accepted + late + refused.reduce((sum, each) => sum + each), frames);
});

test('a program that hangs is reset by its watchdog, and set up anew by the host', () => {
  const board = booted();
  board.pico.hang();
  board.ms(2500);
  assert.equal(board.pico.resets, 1);
  assert.equal(board.port.host.count.enumerations, 2);
  const { reset, starts } = board.identity(WORDS);
  assert.deepEqual({ reset, starts }, { reset: 'Watchdog', starts: 2 });
});
