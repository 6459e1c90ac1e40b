// Serial lines: bytes at the line's speed into a UART, and frames (COBS, ended by a zero) out of one.

const BYTE_NS = 10_000; // 1 Mbit/s, 8N1

// Gives a UART one byte after the other.
export class LineIn {
  constructor(pico, uart) {
    this.uart = uart;
    this.queue = [];
    this.at = 0;
    this.alarm = pico.clock.createAlarm(() => this.arrived());
  }

  get isIdle() { return this.at === this.queue.length; }

  push(bytes) {
    const wasIdle = this.isIdle;
    if (wasIdle) { this.queue = []; this.at = 0; }
    for (const byte of bytes) this.queue.push(byte);
    if (wasIdle && !this.isIdle) this.alarm.schedule(BYTE_NS);
  }

  arrived() {
    this.uart.feed(this.queue[this.at++]);
    if (!this.isIdle) this.alarm.schedule(BYTE_NS);
  }
}

// Cuts a stream of bytes into frames, still encoded, without their zeros.
export class Frames {
  constructor(onFrame) {
    this.bytes = [];
    this.onFrame = onFrame;
  }

  push(byte) {
    if (byte !== 0) { this.bytes.push(byte); return; }
    if (this.bytes.length) this.onFrame(this.bytes);
    this.bytes = [];
  }
}

// The kind of a frame. It is never zero, so COBS leaves it at the second place.
export const kind = (frame) => frame[1];
