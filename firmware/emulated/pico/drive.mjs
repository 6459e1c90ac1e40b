// A drive over USB (class mass storage, bulk-only transport 1.0, SCSI WRITE (10)), as far as dragging a file onto it goes: the chip's own boot ROM is at the other end.
// The file's blocks are written where a computer would put the data of a file; the tables of the file system are left out, since the ROM does not look at them.
import { FIRST_TOGGLE, NAK, STALLED, UsbHost, toggled } from './usb.mjs';

const STORAGE_CLASS = 8, MAX_PACKET = 64, SECTOR = 512;
const COMMAND = 0x43425355, STATUS = 0x53425355, WRITE_10 = 0x2a;
// Where data may be, of the ROM's drive, in sectors; and what a computer writes at a time.
const FIRST_SECTOR = 1024, SECTORS = 64;

export class Drive {
  constructor(pico, host = new UsbHost(pico)) {
    this.host = host;
    this.host.onConfigured = () => this.configured();
    Object.assign(this, { written: 0, answer: [], queue: [], commands: [], failed: 0 });
  }

  configured() {
    const { in: input, out } = this.host.bulk(STORAGE_CLASS);
    Object.assign(this, { input, out, inToggle: FIRST_TOGGLE, outToggle: FIRST_TOGGLE });
    this.host.addPipe(() => this.step());
  }

  get product() { return this.host.descriptors.strings?.[1]; }
  get isIdle() { return this.commands.length === 0; }

  // Copies a file onto the drive.
  copy(file) {
    for (let at = 0; at < file.length; at += SECTOR * SECTORS) {
      this.commands.push({ sector: FIRST_SECTOR + at / SECTOR, data: file.subarray(at, at + SECTOR * SECTORS) });
    }
    this.begin();
  }

  begin() {
    const [command] = this.commands;
    if (!command) return;
    const { sector, data } = command, block = Buffer.alloc(31);
    block.writeUInt32LE(COMMAND, 0);
    block.writeUInt32LE(data.length, 8);
    block[14] = 10;
    block[15] = WRITE_10;
    block.writeUInt32BE(sector, 17);
    block.writeUInt16BE(data.length / SECTOR, 22);
    this.queue = [block];
    for (let at = 0; at < data.length; at += MAX_PACKET) this.queue.push(data.subarray(at, at + MAX_PACKET));
    this.answer = [];
    this.host.wake();
  }

  // A command, its data, and what the drive says of it.
  step() {
    if (this.isIdle) return false;
    return this.queue.length ? this.sends() : this.hears();
  }

  sends() {
    const happened = this.host.out(this.out, this.queue[0], this.outToggle);
    if (happened === NAK || happened === STALLED) return false;
    this.outToggle = toggled(this.outToggle);
    this.queue.shift();
    return true;
  }

  hears() {
    const packet = this.host.in(this.input, this.inToggle);
    if (packet === NAK || packet === STALLED) return false;
    this.inToggle = toggled(this.inToggle);
    this.answer.push(...packet);
    if (this.answer.length < 13) return true;
    const status = Buffer.from(this.answer);
    if (status.readUInt32LE(0) !== STATUS || status[12] !== 0) this.failed++;
    this.commands.shift();
    this.written++;
    this.begin();
    return true;
  }
}
