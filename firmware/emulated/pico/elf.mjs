// What an image holds: its segments, by the address that they are flashed to, and the addresses of its symbols (ELF32, little endian).
import fs from 'node:fs';

const PT_LOAD = 1, SHT_SYMTAB = 2;

export class Elf {
  constructor(file) {
    this.bytes = fs.readFileSync(file);
    this.view = new DataView(this.bytes.buffer, this.bytes.byteOffset, this.bytes.length);
  }

  word(at) { return this.view.getUint32(at, true); }
  half(at) { return this.view.getUint16(at, true); }

  segments() {
    const start = this.word(28), size = this.half(42), count = this.half(44);
    return Array.from({ length: count }, (_, i) => start + i * size)
      .filter((at) => this.word(at) === PT_LOAD && this.word(at + 16) > 0)
      .map((at) => ({ address: this.word(at + 12), bytes: this.bytes.subarray(this.word(at + 4), this.word(at + 4) + this.word(at + 16)) }));
  }

  symbol(name) {
    const start = this.word(32), size = this.half(46), count = this.half(48);
    const section = (i) => start + i * size;
    const table = Array.from({ length: count }, (_, i) => section(i)).find((at) => this.word(at + 4) === SHT_SYMTAB);
    const names = this.word(section(this.word(table + 24)) + 16);
    for (let at = this.word(table + 16), end = at + this.word(table + 20); at < end; at += 16) {
      const from = names + this.word(at);
      if (this.bytes.toString('latin1', from, this.bytes.indexOf(0, from)) === name) return this.word(at + 4);
    }
    throw new Error(`the image has no symbol ${name}`);
  }
}
