// A UF2 file on a Pico as it comes from the factory: the chip's own boot ROM shows a drive, takes the file, flashes it and starts the node.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import path from 'node:path';
import { test } from 'node:test';
import { BOOT_ROM, Board, IMAGES } from '../board.mjs';
import { Drive } from '../drive.mjs';
import { Pico } from '../pico.mjs';
import { KIND, words } from '../words.mjs';

const IMAGE = 'rp2040_pico_usb', FLASH = 0x10000000, BLOCK = 512, FAMILY_AT = 28, MS = 1e6;
const WORDS = words('firmware/emulated/pair.toml', 'time.duration=5ms');
const [NODE] = WORDS.nodes;
const UID = [0xe6, 0x60, 0x58, 0x38, 0x83, 0x2b, 0x10, 7];
const FILE = fs.readFileSync(path.join(IMAGES, `${IMAGE}.uf2`));

function drive(options) {
  const pico = new Pico({ image: path.join(IMAGES, IMAGE), bootRom: BOOT_ROM, uid: UID, ...options });
  return { pico, drive: new Drive(pico) };
}

// Copies a file onto the drive; whether the chip has started anew within these seconds.
function dragged({ pico, drive }, file, seconds) {
  pico.runFor(250 * MS);
  assert.equal(drive.product, 'RP2 Boot');
  drive.copy(file);
  const end = pico.now + seconds * 1e9;
  while (!pico.resets && pico.now < end) pico.runFor(20 * MS);
  return pico.resets > 0;
}

test('a file dragged onto a Pico makes it the node of the image, and what it has stored stays', () => {
  const before = Board.booted(IMAGE, { usb: true });
  assert.deepEqual(before.ask(NODE.configure, KIND.configured).configured, { ok: null });
  assert.equal(typeof before.ask(WORDS.store, KIND.stored).stored.ok, 'number');

  const fresh = drive({ isFlashed: false, storage: before.pico.storage() });
  assert.ok(dragged(fresh, FILE, 10), 'the boot ROM starts the program once it has all blocks');
  assert.equal(fresh.drive.failed, 0);
  for (const { address, bytes } of fresh.pico.elf.segments()) {
    const flashed = fresh.pico.chip.flash.subarray(address - FLASH, address - FLASH + bytes.length);
    assert.ok(Buffer.from(flashed).equals(bytes), `the segment at 0x${address.toString(16)}`);
  }
  const board = Board.at(fresh.pico, fresh.drive.host);
  board.ms(200);
  assert.equal(board.port.serialNumber, Buffer.from(UID).toString('hex'));
  const { id, checksum } = board.identity(WORDS);
  assert.deepEqual([id, checksum], [NODE.id, NODE.checksum]);
});

test('a file of another family, and one that lacks a block, start nothing', () => {
  const other = Buffer.from(FILE);
  for (let at = FAMILY_AT; at < other.length; at += BLOCK) other.writeUInt32LE(0xada52840, at);
  const nrf = drive({ isFlashed: false });
  assert.equal(dragged(nrf, other, 2), false);
  assert.ok(nrf.drive.isIdle, 'the drive takes the file');
  assert.equal(nrf.pico.nor.operations, 0);

  // A transfer of a few blocks is enough for that.
  const few = Buffer.from(FILE.subarray(0, 16 * BLOCK));
  const lacking = drive({ isFlashed: false });
  assert.equal(dragged(lacking, few, 2), false);
  assert.ok(lacking.pico.nor.operations > 0, 'nothing was flashed: the test shows nothing');
});

test('a Pico that has a program is a drive while its button is pressed at the start', () => {
  const { pico, drive: shown } = drive({});
  pico.isPressed = true;
  pico.runFor(250 * MS);
  assert.equal(shown.product, 'RP2 Boot');
  const released = drive({});
  released.pico.runFor(250 * MS);
  assert.equal(released.drive.product, 'Funnelnet node');
});
