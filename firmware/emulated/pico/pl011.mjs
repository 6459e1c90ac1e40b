// The UART of the RP2040 (ARM DDI 0183, PL011): both FIFOs, their thresholds, receive timeout, overrun, and a transmit interrupt
// that comes with the transition through its threshold, as embassy's driver needs it. rp2040js has no FIFOs.
import { BasePeripheral } from 'rp2040js';

const FEN = 0x10;
const ENABLED = 0x001, TRANSMITS = 0x100, RECEIVES = 0x200;
const INTERRUPT = { receive: 1 << 4, transmit: 1 << 5, timeout: 1 << 6, overrun: 1 << 10 };
const OVERRUN_FLAG = 1 << 11;
const DEPTH = 32;
const THRESHOLDS = [4, 8, 16, 24, 28];
const TIMEOUT_BITS = 32;

export class Pl011 extends BasePeripheral {
  constructor(chip, name, irq) {
    super(chip, name);
    this.chip = chip;
    this.irq = irq;
    this.onByte = null;
    this.count = { received: 0, sent: 0, overruns: 0, deaf: 0 };
    this.sending = chip.clock.createAlarm(() => this.sent());
    this.timeout = chip.clock.createAlarm(() => this.timedOut());
    this.reset();
  }

  reset() {
    Object.assign(this, { ibrd: 0, fbrd: 0, lcr: 0, cr: 0x300, ifls: 0x12, imsc: 0, ris: 0, dmacr: 0 });
    Object.assign(this, { rx: [], tx: [], shifting: null, overrun: false, line: false });
    this.sending.cancel();
    this.timeout.cancel();
    this.chip.setInterrupt(this.irq, false);
  }

  get baud() { return this.chip.clkPeri / (16 * (this.ibrd + this.fbrd / 64)); }
  get hasFifo() { return (this.lcr & FEN) !== 0; }
  get depth() { return this.hasFifo ? DEPTH : 1; }
  get bits() {
    const data = 5 + ((this.lcr >> 5) & 3), parity = (this.lcr >> 1) & 1, secondStop = (this.lcr >> 3) & 1;
    return 1 + data + parity + 1 + secondStop;
  }
  get byteNanos() { return (this.bits * 1e9) / this.baud; }
  get transmitLevel() { return this.hasFifo ? THRESHOLDS[this.ifls & 7] ?? 16 : 0; }
  get receiveLevel() { return this.hasFifo ? THRESHOLDS[(this.ifls >> 3) & 7] ?? 16 : 1; }

  // A byte has come on the line; bits 8 to 10 are errors of framing, parity and break.
  feed(byte) {
    if ((this.cr & (ENABLED | RECEIVES)) !== (ENABLED | RECEIVES)) { this.count.deaf++; return; }
    this.count.received++;
    if (this.rx.length >= this.depth) {
      this.overrun = true;
      this.count.overruns++;
      this.raise(INTERRUPT.overrun);
      return;
    }
    this.rx.push(byte | (this.overrun ? OVERRUN_FLAG : 0));
    this.overrun = false;
    if (this.rx.length === this.receiveLevel) this.ris |= INTERRUPT.receive;
    this.timeout.schedule((TIMEOUT_BITS * 1e9) / this.baud);
    this.update();
  }

  timedOut() { if (this.rx.length) this.raise(INTERRUPT.timeout); }

  start() {
    if (this.shifting !== null || !this.tx.length || (this.cr & (ENABLED | TRANSMITS)) !== (ENABLED | TRANSMITS)) return;
    const before = this.tx.length;
    this.shifting = this.tx.shift();
    if (before > this.transmitLevel && this.tx.length <= this.transmitLevel) this.raise(INTERRUPT.transmit);
    this.sending.schedule(this.byteNanos);
  }

  sent() {
    const byte = this.shifting;
    this.shifting = null;
    this.count.sent++;
    this.onByte?.(byte);
    this.start();
  }

  raise(interrupt) { this.ris |= interrupt; this.update(); }

  update() {
    const line = (this.ris & this.imsc) !== 0;
    if (line === this.line) return;
    this.line = line;
    this.chip.setInterrupt(this.irq, line);
  }

  read() {
    const value = this.rx.shift() ?? 0;
    if (this.rx.length < this.receiveLevel) this.ris &= ~INTERRUPT.receive;
    if (this.rx.length) this.timeout.schedule((TIMEOUT_BITS * 1e9) / this.baud);
    else { this.ris &= ~INTERRUPT.timeout; this.timeout.cancel(); }
    this.update();
    return value;
  }

  get flags() {
    const isBusy = this.shifting !== null || this.tx.length > 0;
    return (this.tx.length ? 0 : 0x80) | (this.rx.length >= this.depth ? 0x40 : 0) | (this.tx.length >= this.depth ? 0x20 : 0)
      | (this.rx.length ? 0 : 0x10) | (isBusy ? 0x08 : 0);
  }

  readUint32(offset) {
    switch (offset) {
      case 0x00: return this.read();
      case 0x04: return 0;
      case 0x18: return this.flags;
      case 0x24: return this.ibrd;
      case 0x28: return this.fbrd;
      case 0x2c: return this.lcr;
      case 0x30: return this.cr;
      case 0x34: return this.ifls;
      case 0x38: return this.imsc;
      case 0x3c: return this.ris;
      case 0x40: return this.ris & this.imsc;
      case 0x48: return this.dmacr;
      default: return super.readUint32(offset);
    }
  }

  writeUint32(offset, value) {
    switch (offset) {
      case 0x00: if (this.tx.length < this.depth) this.tx.push(value & 0xff); this.start(); return;
      case 0x04: return;
      case 0x24: this.ibrd = value & 0xffff; return;
      case 0x28: this.fbrd = value & 0x3f; return;
      case 0x2c: this.lcr = value; return;
      case 0x30: this.cr = value; this.start(); return;
      case 0x34: this.ifls = value; return;
      case 0x38: this.imsc = value & 0x7ff; this.update(); return;
      // Cleared by writing ones; the atomic aliases do not count here.
      case 0x44: this.ris &= ~this.rawWriteValue; this.update(); return;
      case 0x48: this.dmacr = value; return;
      default: super.writeUint32(offset, value);
    }
  }
}
