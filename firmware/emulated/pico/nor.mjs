// The Pico's flash chip (Winbond W25Q16JV, data sheet): what the boot ROM, the second-stage boot loader and embassy say to it.
// Its power can be cut at any operation.

const WRITE_ENABLE = 0x06, WRITE_DISABLE = 0x04, PROGRAM = 0x02, READ = 0x03, ERASE_SECTOR = 0x20, ERASE_BLOCK = 0xd8;
const WRITE_STATUS = 0x01, WRITE_STATUS_2 = 0x31, STATUS = 0x05, STATUS_2 = 0x35, JEDEC_ID = 0x9f, UNIQUE_ID = 0x4b;
// Typical times, ns.
const TIME = { status: 1e6, sector: 45e6, block: 150e6, program: 0.7e6 };
const SECTOR = 4096, BLOCK = 65536;

export class PowerCut extends Error {}

export class Nor {
  constructor(chip, uid) {
    this.chip = chip;
    this.uid = uid;
    this.selected = false;
    this.bytes = [];
    this.writable = false;
    this.busyUntil = 0;
    this.status2 = 0;
    this.operations = 0;
    // (operation, how much of it is done when the power goes: 0 to 1), or null.
    this.cutAt = null;
  }

  get busy() { return this.chip.clock.nanos < this.busyUntil; }

  select() {
    if (this.selected) return;
    this.selected = true;
    this.bytes = [];
  }

  deselect() {
    if (!this.selected) return;
    this.selected = false;
    if (this.bytes.length && !this.busy) this.act();
  }

  get address() { return (this.bytes[1] << 16) | (this.bytes[2] << 8) | this.bytes[3]; }

  act() {
    const { bytes } = this, [command] = bytes;
    if (command === WRITE_ENABLE) { this.writable = true; return; }
    if (command === WRITE_DISABLE) { this.writable = false; return; }
    if (!this.writable) return;
    if (command === WRITE_STATUS) { this.status2 = bytes[2] ?? this.status2; this.done(TIME.status); }
    if (command === WRITE_STATUS_2) { this.status2 = bytes[1]; this.done(TIME.status); }
    if (command === ERASE_SECTOR && bytes.length >= 4) this.erase(SECTOR, TIME.sector);
    if (command === ERASE_BLOCK && bytes.length >= 4) this.erase(BLOCK, TIME.block);
    if (command === PROGRAM && bytes.length > 4) this.program();
  }

  done(nanos) {
    this.writable = false;
    this.busyUntil = this.chip.clock.nanos + nanos;
  }

  erase(size, nanos) {
    const start = this.address & ~(size - 1);
    this.perform(size, (upTo) => this.chip.flash.fill(0xff, start, start + upTo));
    this.done(nanos);
  }

  program() {
    const page = this.address & ~0xff, from = this.address & 0xff, data = this.bytes.slice(4);
    this.perform(data.length, (upTo) => {
      // Programming clears bits and sets none.
      data.slice(0, upTo).forEach((byte, i) => { this.chip.flash[page | ((from + i) & 0xff)] &= byte; });
    });
    this.done(TIME.program);
  }

  perform(size, part) {
    const cut = this.cutAt !== null && this.operations === this.cutAt.operation;
    this.operations++;
    part(cut ? Math.floor(size * this.cutAt.depth) : size);
    if (cut) throw new PowerCut();
  }

  // One byte out, one byte in.
  shift(out) {
    this.bytes.push(out);
    const n = this.bytes.length - 1, [command] = this.bytes;
    if (n === 0) return 0xff;
    if (command === STATUS) return (this.busy ? 1 : 0) | (this.writable ? 2 : 0);
    if (this.busy) return 0xff;
    if (command === STATUS_2) return this.status2;
    if (command === JEDEC_ID) return [0xef, 0x40, 0x15][n - 1] ?? 0;
    if (command === UNIQUE_ID && n >= 5) return this.uid[(n - 5) % 8];
    if (command === READ && n >= 4) return this.chip.flash[(this.address + n - 4) & 0x1fffff];
    return 0xff;
  }
}
