// The image that checks its own board: all is well with all of its hardware there, and each check says what is missing where it is taken away.
import assert from 'node:assert/strict';
import path from 'node:path';
import { test } from 'node:test';
import { BOOT_ROM, Board, IMAGES } from '../board.mjs';
import { LineIn } from '../line.mjs';
import { Pico, STORAGE } from '../pico.mjs';
import { Registers } from '../registers.mjs';
import { KIND, words } from '../words.mjs';

const IMAGE = 'board_check_pico', NODE_IMAGE = 'rp2040_pico';
const WORDS = words('firmware/emulated/pair.toml', 'time.duration=5ms');
const [NODE] = WORDS.nodes;
const MS = 1e6, LONGEST_MS = 60_000, SECTOR = 4096;
const XOSC = 0x40024, TIMER = 0x40054, PIN = 2, TICKS = 1000;
const UID = [0xe6, 0x60, 0x58, 0x38, 0x83, 0x2b, 0x10, 7];
const CHECKS = ['unique number', 'clock', 'ticks', 'serial echo', 'CAN loop-back', 'program', 'erase', 'stored configuration', 'watchdog'];

// A Pico with a wire for the echo, which `wire` may change or, with null, not have; `spoil` takes hardware away.
class Checked {
  constructor({ storage = null, uid = UID, wire = (byte) => byte, spoil = () => {} } = {}) {
    const pico = (this.pico = new Pico({ image: path.join(IMAGES, IMAGE), bootRom: BOOT_ROM, storage, uid }));
    const [host, echo] = pico.uarts, back = new LineIn(pico, echo);
    this.text = '';
    host.onByte = (byte) => { this.text += String.fromCharCode(byte); };
    echo.onByte = (byte) => { if (wire) back.push([wire(byte)]); };
    this.changes = 0;
    pico.chip.gpio[PIN].addListener(() => this.changes++);
    spoil(pico, this);
  }

  // Until it has said this; what it took, ms.
  until(wanted) {
    const { pico } = this, begin = pico.now;
    while (!wanted.test(this.text) && pico.now < begin + LONGEST_MS * MS) pico.runFor(5 * MS);
    assert.match(this.text, wanted, 'not within a minute');
    return (pico.now - begin) / MS;
  }

  // Until its report ends.
  run() { return this.until(/DONE.*\r\n/); }

  // Rows by their check, and the verdicts of all of them, in order.
  rows() {
    const rows = this.text.split('\r\n').filter((line) => line.startsWith(`| ${IMAGE}`)).map((line) => line.split('|').slice(2, -1).map((cell) => cell.trim()));
    assert.deepEqual(rows.map(([check]) => check), CHECKS, this.text);
    return Object.fromEntries(rows.map(([check, verdict, measured, limit]) => [check, { verdict, measured, limit }]));
  }

  verdicts() { return Object.fromEntries(Object.entries(this.rows()).map(([check, { verdict }]) => [check, verdict])); }
}

// What all say with everything there; the chip has no CAN controller.
const all = (others = {}) => ({ ...Object.fromEntries(CHECKS.map((check) => [check, 'PASS'])), 'CAN loop-back': 'SKIPPED', ...others });

function stored() {
  const board = Board.booted(NODE_IMAGE);
  assert.deepEqual(board.ask(NODE.configure, KIND.configured).configured, { ok: null });
  assert.equal(typeof board.ask(WORDS.store, KIND.stored).stored.ok, 'number');
  return board.pico.storage();
}

test('with all of its hardware every check passes, and the stored configuration stays', () => {
  const storage = stored(), board = new Checked({ storage });
  const took = board.run();
  console.log(board.text.replaceAll(/^(?=.)/gm, '# '));
  assert.deepEqual(board.verdicts(), all());
  assert.match(board.text, /^\| board \| check \| verdict \| measured \| limit \|\r\n\|---\|---\|---\|---\|---\|\r\n/);
  assert.match(board.text, /DONE: 8 PASS, 0 FAIL, 1 SKIPPED\r\n$/);
  assert.ok(took < LONGEST_MS, `${took} ms`);
  const rows = board.rows();
  assert.equal(rows['unique number'].measured, '0xe6605838832b1007');
  assert.match(rows['stored configuration'].measured, /^node 1, checksum 0x[0-9a-f]{8}$/);
  assert.equal(board.pico.resets, 1, 'the watchdog of the image has bitten, once');
  assert.ok(board.changes >= TICKS - 1, `the pin has changed ${board.changes} times`);
  // One page at most is not what it was, and it is blank now.
  const after = board.pico.storage(), pages = Array.from({ length: storage.length / SECTOR }, (_, i) => [storage, after].map((all) => all.slice(i * SECTOR, (i + 1) * SECTOR)));
  const changed = pages.filter(([before, now]) => Buffer.compare(Buffer.from(before), Buffer.from(now)) !== 0);
  assert.ok(changed.length <= 1, `${changed.length} pages have changed`);
  const { id, checksum } = Board.booted(NODE_IMAGE, { storage: after }).identity(WORDS);
  assert.deepEqual({ id, checksum }, { id: NODE.id, checksum: NODE.checksum });
  // It is done: nothing more is said, and it is not reset any more.
  const { text } = board;
  board.pico.runFor(5000 * MS);
  assert.deepEqual([board.text, board.pico.resets], [text, 1]);
});

test('no jumper, no number, flash that keeps nothing and a watchdog that does not bite are each found', () => {
  const board = new Checked({
    uid: Array(8).fill(0xff),
    wire: null,
    spoil: ({ nor, watchdog }) => {
      nor.program = () => nor.done(0.7e6);
      watchdog.onWatchdogTrigger = () => { watchdog.alarm.enable = watchdog.timer.enable = false; };
    },
  });
  board.run();
  assert.deepEqual(board.verdicts(), all({ 'unique number': 'FAIL', 'serial echo': 'SKIPPED', program: 'FAIL', watchdog: 'FAIL' }));
  const rows = board.rows();
  assert.match(rows['serial echo'].measured, /no jumper from GP4 to GP5/);
  assert.match(rows.program.measured, / bytes wrong$/);
  assert.match(rows.watchdog.measured, /^no reset within/);
  assert.equal(rows['stored configuration'].measured, 'none');
});

test('a bad wire, ticks that jitter, no crystal, flash that is not erased and a reset that is not the watchdog\'s are each found', () => {
  let sent = 0;
  const board = new Checked({
    wire: (byte) => (++sent % 50 === 0 ? byte ^ 4 : byte),
    spoil: (pico, checked) => {
      const { nor, chip } = pico;
      // The timer's alarms come up to 0.1 ms late.
      let draw = 1;
      for (const { clockAlarm } of chip.peripherals[TIMER].alarms) {
        const schedule = clockAlarm.schedule.bind(clockAlarm);
        clockAlarm.schedule = (nanos) => {
          draw = (Math.imul(draw, 1103515245) + 12345) >>> 0;
          schedule(nanos + ((draw >>> 8) % 100_000));
        };
      }
      chip.peripherals[XOSC] = new Registers(chip, 'XOSC', {}, () => false);
      nor.erase = (size, nanos) => nor.done(nanos);
      // Somebody presses its button while it waits for the watchdog.
      checked.press = () => { pico.wantsReset = true; };
    },
  });
  board.until(/stored configuration.*\r\n/);
  board.pico.runFor(500 * MS);
  board.press();
  board.run();
  assert.deepEqual(board.verdicts(), all({ clock: 'FAIL', ticks: 'FAIL', 'serial echo': 'FAIL', erase: 'FAIL', watchdog: 'FAIL' }));
  const rows = board.rows();
  assert.match(rows['serial echo'].measured, /^256 bytes, 5 wrong$/);
  assert.match(rows.erase.measured, / bytes not erased$/);
  assert.match(rows.watchdog.measured, /^reset by .* after [45]\d\d,\d{3} us$/);
});

test('an erase that takes too long, and one that takes the configuration with it, are found', () => {
  const board = new Checked({
    storage: stored(),
    spoil: ({ nor, chip }) => {
      nor.erase = () => { chip.flash.fill(0xff, STORAGE.start, STORAGE.end); nor.done(450e6); };
    },
  });
  board.run();
  assert.deepEqual(board.verdicts(), all({ erase: 'FAIL', 'stored configuration': 'FAIL' }));
  assert.equal(board.rows()['stored configuration'].measured, 'none');
});

test('a reset in the middle of a check ends the report', () => {
  const board = new Checked();
  board.until(/clock.*\r\n/);
  board.pico.runFor(500 * MS);
  board.pico.hang();
  board.run();
  assert.match(board.text, /\| ticks \| FAIL \| reset in it: the watchdog \| no reset \|\r\nDONE: 2 PASS, 1 FAIL, 0 SKIPPED\r\n$/);
});
