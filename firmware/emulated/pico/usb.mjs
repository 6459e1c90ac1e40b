// The computer's side of a Pico's USB connector, at full speed: cable, bus reset, enumeration, control transfers, and one transaction after the other.
//
// rp2040js has the registers of the controller, but takes every packet from the program at once and gives it none: here a packet stays in its buffer until the
// host asks (a host may be busy, or not there), data toggles are checked, and a transfer ends with a packet that is not full. USB 2.0, chapters 5, 8 and 9; RP2040 data sheet, 4.1.
//
// Not shown: SOF, electrical levels, bit errors, and how a real host shares its frames of 1 ms between devices.

const EP0 = 0, MAX_PACKET = 64;
// Bits of a buffer's control half-word, and of an endpoint's word.
const AVAILABLE = 1 << 10, STALL = 1 << 11, SELECT_FIRST = 1 << 12, DATA1 = 1 << 13, FULL = 1 << 15, LENGTH = 0x3ff;
const ENABLED = 1 << 31, DOUBLE = 1 << 30;
const BUS_RESET = 1 << 19, SETUP_RECEIVED = 1 << 17, SUSPENDED = 1 << 4;
const PULL_UP = 1 << 16, CONTROLLER_ON = 1;
const SIE_STATUS = 0x50, BUFF_STATUS = 0x58, BUFF_CPU_SHOULD_HANDLE = 0x5c;
const SUSPEND_INTERRUPT = 1 << 14;
// What a transaction takes: 19 packets of 64 bytes fit into a frame of 1 ms.
const TRANSACTION_NS = 1e6 / 19;
const DEBOUNCE_NS = 100e6, RESET_NS = 10e6, SUSPEND_NS = 3e6;
const GET_DESCRIPTOR = 6, SET_ADDRESS = 5, SET_CONFIGURATION = 9;
const DEVICE = 1, CONFIGURATION = 2, STRING = 3, INTERFACE = 4, ENDPOINT = 5;
const ADDRESS = 1, ENGLISH = 0x0409;
const BULK = 2;

export const NAK = 'NAK', STALLED = 'STALL';

const low = (value) => value & 0xff, high = (value) => (value >> 8) & 0xff;
const setupPacket = ({ type, request, value = 0, index = 0, length = 0 }) =>
  Uint8Array.of(type, request, low(value), high(value), low(index), high(index), low(length), high(length));

// A control transfer, one transaction at a time.
class Control {
  constructor(setup, data, done) {
    Object.assign(this, { setup, data, done, received: [], sent: 0, toggle: DATA1, stage: 'setup' });
    this.isIn = (setup[0] & 0x80) !== 0;
    this.length = setup[6] | (setup[7] << 8);
  }

  // Whether the bus was used. `done` is called with what came, or with null for a refusal.
  step(host) {
    if (this.stage === 'setup') { host.setup(this.setup); this.stage = this.length ? 'data' : 'status'; return true; }
    const happened = this.stage === 'data' ? this.transferred(host) : this.acknowledged(host);
    if (happened === STALLED) host.finish(this, null);
    return happened !== NAK;
  }

  transferred(host) {
    const happened = this.isIn ? host.in(EP0, this.toggle) : host.out(EP0, this.data.slice(this.sent, this.sent + MAX_PACKET), this.toggle);
    if (happened === NAK || happened === STALLED) return happened;
    this.toggle ^= DATA1;
    if (this.isIn) this.received.push(...happened);
    else this.sent += Math.min(MAX_PACKET, this.data.length - this.sent);
    const isShort = this.isIn && happened.length < MAX_PACKET;
    if (isShort || (this.isIn ? this.received : { length: this.sent }).length >= this.length) this.stage = 'status';
    return happened;
  }

  acknowledged(host) {
    const happened = this.isIn && this.length ? host.out(EP0, [], DATA1) : host.in(EP0, DATA1);
    if (happened !== NAK && happened !== STALLED) host.finish(this, Uint8Array.from(this.received));
    return happened;
  }
}

export class UsbHost {
  constructor(pico) {
    this.pico = pico;
    pico.usb = this;
    this.usb = pico.chip.usbCtrl;
    this.memory = pico.chip.usbDPRAMView;
    // The device is set up, and may be spoken to.
    this.onConfigured = () => {};
    this.isPlugged = true;
    this.count = { toggleErrors: 0, enumerations: 0, stalls: 0 };
    this.timer = pico.clock.createAlarm(() => this.due());
    this.turn = pico.clock.createAlarm(() => this.turned());
    this.forget();
    this.connectRegisters();
  }

  forget() {
    Object.assign(this, { controls: [], pipes: [], isWaiting: false, isPresent: false, isConfigured: false, next: null, descriptors: {} });
    this.forgetBuffers();
  }

  // Of each endpoint and direction: the buffer whose turn it is, and those that the program is yet to be told of.
  forgetBuffers() {
    this.turns = new Array(32).fill(0);
    this.done = Array.from({ length: 32 }, () => []);
  }

  connectRegisters() {
    const { usb } = this;
    // What the program has put into a buffer waits there for the host.
    usb.DPRAMUpdated = () => this.wake();
    usb.onUSBEnabled = () => this.look();
    const control = usb.handleSieCtrlWrite.bind(usb), write = usb.writeUint32.bind(usb), read = usb.readUint32.bind(usb);
    usb.handleSieCtrlWrite = (value) => { control(value); this.look(); };
    usb.writeUint32 = (offset, value) => {
      // rp2040js does not know that this one is cleared by writing a one.
      if (offset === SIE_STATUS && usb.rawWriteValue & SUSPENDED) { usb.sieStatus &= ~SUSPENDED; usb.intRaw &= ~SUSPEND_INTERRUPT; }
      write(offset, value);
      if (offset === BUFF_STATUS) this.told(usb.rawWriteValue);
    };
    usb.readUint32 = (offset) => (offset === BUFF_CPU_SHOULD_HANDLE ? this.done.reduce((bits, [which], i) => bits | (which ? 1 << i : 0), 0) >>> 0 : read(offset));
  }

  // The program has taken note of buffers that are done; one that was done meanwhile comes up then.
  told(bits) {
    this.done.forEach((done, i) => {
      if (!(bits & (1 << i)) || !done.length) return;
      done.shift();
      if (done.length) this.usb.indicateBufferReady(i >> 1, (i & 1) === 1);
    });
  }

  // --- cable and device

  get isPulledUp() { return this.isPlugged && (this.usb.sieCtrl & PULL_UP) !== 0 && (this.usb.mainCtrl & CONTROLLER_ON) !== 0; }

  // The chip has been reset, or its power has gone.
  deviceReset() {
    Object.assign(this.usb, { mainCtrl: 0, sieCtrl: 0, sieStatus: 0, intRaw: 0, intEnable: 0, intForce: 0, buffStatus: 0, addrEndp: 0, epStallArm: 0 });
    this.timer.cancel();
    this.turn.cancel();
    this.forget();
  }

  // Something may have been plugged in.
  look() {
    if (this.isPulledUp === this.isPresent) return;
    this.isPresent = this.isPulledUp;
    if (this.isPresent) this.after(DEBOUNCE_NS, () => this.resetBus());
  }

  unplug() {
    this.isPlugged = false;
    this.timer.cancel();
    this.turn.cancel();
    this.forget();
    // The device has a supply of its own, and hears no SOF any more.
    this.after(SUSPEND_NS, () => {
      this.usb.sieStatus |= SUSPENDED;
      this.usb.sieStatusUpdated();
    });
  }

  plug() {
    this.isPlugged = true;
    this.look();
  }

  after(nanos, what) {
    this.next = what;
    this.timer.schedule(nanos);
  }

  due() {
    const { next } = this;
    this.next = null;
    next?.();
  }

  resetBus() {
    this.usb.sieStatus |= BUS_RESET;
    this.usb.sieStatusUpdated();
    this.forgetBuffers();
    this.after(RESET_NS, () => this.enumerate());
  }

  enumerate() {
    const { descriptors } = this;
    this.descriptor(DEVICE, 0, 18, (device) => {
      descriptors.device = device;
      this.control({ type: 0, request: SET_ADDRESS, value: ADDRESS }, [], () => this.strings(() => this.configure()));
    });
  }

  descriptor(kind, index, length, done, language = 0) {
    this.control({ type: 0x80, request: GET_DESCRIPTOR, value: (kind << 8) | index, index: language, length }, [], done);
  }

  // Manufacturer, product, serial number.
  strings(done) {
    const { device } = this.descriptors, numbers = [device[14], device[15], device[16]];
    this.descriptors.strings = [];
    numbers.forEach((number, i) => this.descriptor(STRING, number, 255, (text) => {
      this.descriptors.strings.push(text && Buffer.from(text.slice(2)).toString('utf16le'));
      if (i === numbers.length - 1) done();
    }, ENGLISH));
  }

  configure() {
    this.descriptor(CONFIGURATION, 0, 9, (head) => {
      this.descriptor(CONFIGURATION, 0, head[2] | (head[3] << 8), (configuration) => {
        this.descriptors.configuration = configuration;
        this.control({ type: 0, request: SET_CONFIGURATION, value: configuration[5] }, [], () => {
          this.isConfigured = true;
          this.count.enumerations++;
          this.onConfigured();
        });
      });
    });
  }

  // Bulk endpoints of the interfaces of a class.
  bulk(wanted) {
    const { configuration } = this.descriptors, found = { in: null, out: null };
    let isWanted = false;
    for (let at = 0; at < configuration.length; at += configuration[at]) {
      const [, kind, address, attributes] = configuration.slice(at);
      if (kind === INTERFACE) isWanted = configuration[at + 5] === wanted;
      if (kind === ENDPOINT && isWanted && (attributes & 3) === BULK) found[address & 0x80 ? 'in' : 'out'] = address & 0xf;
    }
    return found;
  }

  // --- transactions

  word(at) { return this.memory.getUint32(at, true); }

  // The buffer of an endpoint whose turn it is, or null where the endpoint is off.
  buffer(endpoint, isOut) {
    const at = 8 * endpoint + (isOut ? 4 : 0), index = 2 * endpoint + (isOut ? 1 : 0);
    const settings = endpoint === EP0 ? ENABLED : this.word(at);
    if (!(settings & ENABLED)) return null;
    const first = this.memory.getUint16(0x80 + at, true);
    if (first & SELECT_FIRST) {
      this.turns[index] = 0;
      this.memory.setUint16(0x80 + at, first & ~SELECT_FIRST, true);
    }
    const which = this.turns[index];
    const start = this.usb.getEndpointBufferOffset(endpoint, isOut) + which * MAX_PACKET, place = 0x80 + at + 2 * which;
    const finish = (control) => {
      this.memory.setUint16(place, control & ~AVAILABLE, true);
      if (settings & DOUBLE) this.turns[index] ^= 1;
      this.done[index].push(which);
      this.usb.indicateBufferReady(endpoint, isOut);
    };
    return { control: this.memory.getUint16(place, true), start, finish };
  }

  setup(packet) {
    this.usb.epStallArm = 0;
    this.usb.sendSetupPacket(packet);
  }

  // The buffer, if it takes part in a transaction; else NAK or STALLED.
  ready(endpoint, isOut) {
    const buffer = this.buffer(endpoint, isOut);
    if (buffer && buffer.control & STALL) { this.count.stalls++; return STALLED; }
    return buffer && buffer.control & AVAILABLE ? buffer : NAK;
  }

  // Bytes, NAK or STALLED. A packet with the wrong toggle was there already, and is dropped.
  in(endpoint, toggle) {
    const buffer = this.ready(endpoint, false);
    if (buffer === NAK || buffer === STALLED) return buffer;
    const data = this.pico.chip.usbDPRAM.slice(buffer.start, buffer.start + (buffer.control & LENGTH));
    buffer.finish(buffer.control & ~FULL);
    if ((buffer.control & DATA1) === toggle) return data;
    this.count.toggleErrors++;
    return NAK;
  }

  out(endpoint, data, toggle) {
    const buffer = this.ready(endpoint, true);
    if (buffer === NAK || buffer === STALLED) return buffer;
    // The device takes it for one that it has had, and says that it has it.
    if ((buffer.control & DATA1) !== toggle) { this.count.toggleErrors++; return data; }
    this.pico.chip.usbDPRAM.set(data, buffer.start);
    buffer.finish((buffer.control & ~LENGTH) | FULL | data.length);
    return data;
  }

  // --- transfers

  control(setup, data, done = () => {}) {
    this.controls.push(new Control(setupPacket({ ...setup, length: setup.length ?? data.length }), data, done));
    this.wake();
  }

  finish(control, result) {
    this.controls.splice(this.controls.indexOf(control), 1);
    control.done(result);
  }

  // `step(host)` is called when it is this pipe's turn; whether it has used the bus.
  addPipe(step) {
    this.pipes.push(step);
    this.wake();
  }

  // Something may go on: a buffer, a transfer.
  wake() {
    if (this.isWaiting || !this.isPresent) return;
    this.isWaiting = true;
    this.turn.schedule(TRANSACTION_NS);
  }

  // One transaction of each transfer that can go on.
  turned() {
    this.isWaiting = false;
    const [control] = this.controls;
    let used = control ? control.step(this) : false;
    for (const step of this.pipes) used = step(this) || used;
    if (used) this.wake();
  }
}

export const toggled = (toggle) => toggle ^ DATA1;
export const FIRST_TOGGLE = 0;
