// Registers that hold what is written, but for those that `onWrite` takes care of (it returns true then).
import { BasePeripheral } from 'rp2040js';

export class Registers extends BasePeripheral {
  constructor(chip, name, start, onWrite) {
    super(chip, name);
    this.start = start;
    this.onWrite = onWrite;
    this.reset();
  }

  reset() { this.held = { ...this.start }; }

  readUint32(offset) { return this.held[offset] ?? 0; }

  writeUint32(offset, value) {
    if (this.onWrite?.(offset, value, this) !== true) this.held[offset] = value >>> 0;
  }
}
