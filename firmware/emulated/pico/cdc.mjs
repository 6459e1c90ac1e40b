// A serial port over USB, as Linux's cdc_acm makes one of a device of the class CDC-ACM (USB CDC 1.2, PSTN 1.2).
import { FIRST_TOGGLE, NAK, STALLED, UsbHost, toggled } from './usb.mjs';

const DATA_CLASS = 10, MAX_PACKET = 64;
// cdc_acm asks for two packets at a time, and gives its program nothing before a packet that is not full, or both.
const TRANSFER = 2 * MAX_PACKET;
const SET_LINE_CODING = 0x20, SET_CONTROL_LINE_STATE = 0x22, TO_INTERFACE = 0x21;
const DTR_AND_RTS = 3;
const BIT_RATE_115200_8N1 = [0x00, 0xc2, 0x01, 0x00, 0, 0, 8];

export class SerialPort {
  // A program opens the port as soon as there is one. `hearsEmpty`: else the computer is never told that a transfer has ended with a full packet.
  constructor(pico, host = new UsbHost(pico)) {
    Object.assign(this, { isReading: true, hearsEmpty: true, isOpen: false, queue: [], transfer: [] });
    this.count = { sent: 0, packets: 0, full: 0, empty: 0, bytes: 0 };
    this.host = host;
    this.host.onConfigured = () => this.configured();
    this.onData = () => {};
  }

  get serialNumber() { return this.host.descriptors.strings?.[2]; }

  configured() {
    const { in: input, out } = this.host.bulk(DATA_CLASS);
    Object.assign(this, { input, out, inToggle: FIRST_TOGGLE, outToggle: FIRST_TOGGLE, transfer: [], queue: [], isOpen: false });
    this.host.addPipe(() => this.write());
    this.host.addPipe(() => this.read());
    this.open();
  }

  open() {
    this.host.control({ type: TO_INTERFACE, request: SET_LINE_CODING }, BIT_RATE_115200_8N1);
    this.host.control({ type: TO_INTERFACE, request: SET_CONTROL_LINE_STATE, value: DTR_AND_RTS }, [], () => { this.isOpen = true; });
  }

  // The program has ended: nobody asks for data.
  close() {
    this.isOpen = false;
    this.transfer = [];
    this.host.control({ type: TO_INTERFACE, request: SET_CONTROL_LINE_STATE, value: 0 }, []);
  }

  // Bytes of a program.
  push(bytes) {
    if (!this.isOpen) return;
    for (let at = 0; at < bytes.length; at += MAX_PACKET) this.queue.push(Uint8Array.from(bytes.slice(at, at + MAX_PACKET)));
    this.host.wake();
  }

  get isIdle() { return this.queue.length === 0; }

  // Goes on reading.
  resume() {
    this.isReading = true;
    this.host.wake();
  }

  write() {
    const [packet] = this.queue;
    if (!packet) return false;
    const happened = this.host.out(this.out, packet, this.outToggle);
    if (happened === NAK || happened === STALLED) return false;
    this.outToggle = toggled(this.outToggle);
    this.queue.shift();
    this.count.sent++;
    return true;
  }

  read() {
    if (!this.isOpen || !this.isReading) return false;
    const packet = this.host.in(this.input, this.inToggle);
    if (packet === NAK || packet === STALLED) return false;
    this.inToggle = toggled(this.inToggle);
    this.note(packet);
    if (packet.length === 0 && !this.hearsEmpty) return true;
    this.transfer.push(...packet);
    if (packet.length < MAX_PACKET || this.transfer.length >= TRANSFER) this.complete();
    return true;
  }

  note({ length }) {
    this.count.packets++;
    this.count.bytes += length;
    if (length === MAX_PACKET) this.count.full++;
    if (length === 0) this.count.empty++;
  }

  complete() {
    const bytes = this.transfer;
    this.transfer = [];
    if (bytes.length) this.onData(Uint8Array.from(bytes));
  }
}
