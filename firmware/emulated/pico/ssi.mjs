// The RP2040's flash interface (data sheet 4.10, DW_apb_ssi) in the modes that the boot ROM, the second-stage boot loader and embassy use.
// Reading memory-mapped flash is rp2040js's own business.
import { BasePeripheral } from 'rp2040js';

const CTRLR0 = 0x00, CTRLR1 = 0x04, SSIENR = 0x08, RXFLR = 0x24, SR = 0x28, DR0 = 0x60;
const EEPROM_READ = 3;
// The override of the chip select, IO_QSPI GPIO_QSPI_SS_CTRL.OUTOVER.
const LOW = 2, HIGH = 3;

export class Ssi extends BasePeripheral {
  constructor(chip, name, nor) {
    super(chip, name);
    this.nor = nor;
    this.reset();
  }

  reset() {
    this.held = { [CTRLR0]: 0, [CTRLR1]: 0, [SSIENR]: 0, 0x10: 1, 0x14: 0, 0xf0: 0, 0xf4: 0x03000000, 0xf8: 0 };
    this.received = [];
    this.command = [];
    this.select = 0;
    this.selectsByItself = false;
  }

  // The program has written the control register of the chip-select pin.
  setPin(control) {
    this.select = (control >> 8) & 3;
    if (this.select === LOW) { this.nor.select(); return; }
    this.settle();
    this.nor.deselect();
  }

  // What waits in the transmit FIFO has gone out.
  settle() {
    if (this.command.length) {
      this.nor.select();
      this.command.forEach((byte) => this.nor.shift(byte));
      this.command = [];
      for (let i = 0; i <= this.held[CTRLR1]; i++) this.received.push(this.nor.shift(0));
      this.nor.deselect();
    }
    if (!this.selectsByItself) return;
    this.selectsByItself = false;
    if (this.select !== LOW) this.nor.deselect();
  }

  transfer(byte) {
    if (!(this.held[SSIENR] & 1)) return;
    // Quad formats only set up reading memory-mapped flash.
    if ((this.held[CTRLR0] >> 21) & 3) return;
    if (((this.held[CTRLR0] >> 8) & 3) === EEPROM_READ) { this.command.push(byte); return; }
    if (this.select === HIGH) { this.received.push(0xff); return; }
    if (this.select !== LOW) { this.nor.select(); this.selectsByItself = true; }
    this.received.push(this.nor.shift(byte));
  }

  readUint32(offset) {
    switch (offset) {
      case 0x20: case 0x2c: case 0x30: case 0x34: case 0x48: return 0;
      case RXFLR: return this.received.length;
      case SR: this.settle(); return 0x6 | (this.received.length ? 8 : 0);
      case 0x58: return 0x51535049;
      case 0x5c: return 0x3430312a;
      case DR0: this.settle(); return this.received.shift() ?? 0;
      default: return offset in this.held ? this.held[offset] : super.readUint32(offset);
    }
  }

  writeUint32(offset, value) {
    if (offset === DR0) { this.transfer(value & 0xff); return; }
    if (offset === SSIENR && !(value & 1)) { this.settle(); this.received = []; }
    if (offset in this.held) this.held[offset] = value >>> 0;
    else super.writeUint32(offset, value);
  }
}
