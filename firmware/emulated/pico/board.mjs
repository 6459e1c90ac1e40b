// A Pico with a host at its line, in virtual time: the same every time.
import path from 'node:path';
import { SerialPort } from './cdc.mjs';
import { Frames, LineIn, kind } from './line.mjs';
import { Pico, bootRom } from './pico.mjs';
import { KIND, ROOT, bytes, read } from './words.mjs';

export const IMAGES = path.join(ROOT, 'firmware/target/thumbv6m-none-eabi/release');
export const BOOT_ROM = bootRom(path.join(ROOT, 'target/emulated/bootrom.bin'));
const MS = 1e6;
const STEP_NS = 50_000;
// From power on to a node that listens; over USB the host has set up the line by then.
const BOOT_MS = 20, USB_BOOT_MS = 150;

export class Board {
  // `usb`: its line is that of its USB connector.
  constructor(image, { storage = null, uid, usb = false } = {}) {
    this.pico = new Pico({ image: path.join(IMAGES, image), bootRom: BOOT_ROM, storage, uid });
    this.bootMs = usb ? USB_BOOT_MS : BOOT_MS;
    this.listen(usb ? new SerialPort(this.pico) : null);
  }

  // A Pico that runs already, at a computer's USB.
  static at(pico, host) {
    const board = Object.assign(Object.create(Board.prototype), { pico });
    board.listen(new SerialPort(pico, host));
    return board;
  }

  // Takes what comes from a port over USB, or from its UART.
  listen(port) {
    this.said = [];
    const frames = new Frames((frame) => this.said.push({ at: this.pico.now, frame }));
    if (port) {
      this.line = this.port = port;
      port.onData = (bytes) => bytes.forEach((byte) => frames.push(byte));
      return;
    }
    [this.uart] = this.pico.uarts;
    this.line = new LineIn(this.pico, this.uart);
    this.uart.onByte = (byte) => frames.push(byte);
  }

  // One that has started.
  static booted(image, options) {
    const board = new Board(image, options);
    board.ms(board.bootMs);
    return board;
  }

  ms(count) { this.pico.runFor(count * MS); }

  tell(hex) { this.line.push(bytes(hex)); }

  // Says something and waits for a frame of this kind; what that says, or null.
  ask(hex, wanted, withinMs = 1000) {
    const from = this.said.length, end = this.pico.now + withinMs * MS;
    this.tell(hex);
    while (this.pico.now < end) {
      this.pico.runFor(STEP_NS);
      const answer = this.said.slice(from).find(({ frame }) => kind(frame) === wanted);
      if (answer) return read([answer.frame])[0];
    }
    return null;
  }

  identity(words) { return this.ask(words.hello, KIND.identity)?.identity ?? null; }

  // The same flash in a board that has had no supply.
  powerCycled(image, options) { return Board.booted(image, { ...options, storage: this.pico.storage() }); }
}
