// The computer's side of a Pico's USB connector, at full speed: cable, bus reset, enumeration, control transfers, and one transaction after the other.
//
// rp2040js has the registers of the controller, but takes every packet from the program at once and gives it none: here a packet stays in its buffer until the
// host asks (a host may be busy, or not there), data toggles are checked, and a transfer ends with a packet that is not full. USB 2.0, chapters 5, 8 and 9; RP2040 data sheet, 4.1.
//
// Not shown: SOF, electrical levels, bit errors, and how a real host shares its frames of 1 ms between devices.

const EP0 = 0, MAX_PACKET = 64;
// Bits of a buffer's control word, and of an endpoint's.
const AVAILABLE = 1 << 10, STALL = 1 << 11, DATA1 = 1 << 13, FULL = 1 << 15, LENGTH = 0x3ff, ENABLED = 1 << 31;
const BUS_RESET = 1 << 19, SETUP_RECEIVED = 1 << 17, SUSPENDED = 1 << 4;
const PULL_UP = 1 << 16, CONTROLLER_ON = 1;
const SIE_STATUS = 0x50;
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
  // `onConfigured`: the device is set up, and may be spoken to.
  constructor(pico, { onConfigured = () => {} } = {}) {
    this.pico = pico;
    pico.usb = this;
    this.usb = pico.chip.usbCtrl;
    this.memory = pico.chip.usbDPRAMView;
    this.onConfigured = onConfigured;
    this.isPlugged = true;
    this.count = { toggleErrors: 0, enumerations: 0, stalls: 0 };
    this.timer = pico.clock.createAlarm(() => this.due());
    this.turn = pico.clock.createAlarm(() => this.turned());
    this.forget();
    this.connectRegisters();
  }

  forget() {
    Object.assign(this, { controls: [], pipes: [], isWaiting: false, isPresent: false, isConfigured: false, next: null, descriptors: {} });
  }

  connectRegisters() {
    const { usb } = this;
    // What the program has put into a buffer waits there for the host.
    usb.DPRAMUpdated = () => this.wake();
    usb.onUSBEnabled = () => this.look();
    const control = usb.handleSieCtrlWrite.bind(usb), write = usb.writeUint32.bind(usb);
    usb.handleSieCtrlWrite = (value) => { control(value); this.look(); };
    usb.writeUint32 = (offset, value) => {
      // rp2040js does not know that this one is cleared by writing a one.
      if (offset === SIE_STATUS && usb.rawWriteValue & SUSPENDED) { usb.sieStatus &= ~SUSPENDED; usb.intRaw &= ~SUSPEND_INTERRUPT; }
      write(offset, value);
    };
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
          this.onConfigured(this);
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

  // The control word of a buffer, unless its endpoint is off.
  buffer(endpoint, isOut) {
    if (endpoint !== EP0 && !(this.word(8 * endpoint + (isOut ? 4 : 0)) & ENABLED)) return null;
    return 0x80 + 8 * endpoint + (isOut ? 4 : 0);
  }

  setup(packet) {
    this.usb.epStallArm = 0;
    this.usb.sendSetupPacket(packet);
  }

  // Bytes, NAK or STALLED. A packet with the wrong toggle was there already, and is dropped.
  in(endpoint, toggle) {
    const at = this.buffer(endpoint, false), control = at === null ? 0 : this.word(at);
    if (control & STALL) { this.count.stalls++; return STALLED; }
    if (!(control & AVAILABLE)) return NAK;
    const start = this.usb.getEndpointBufferOffset(endpoint, false), data = this.pico.chip.usbDPRAM.slice(start, start + (control & LENGTH));
    this.memory.setUint32(at, control & ~(AVAILABLE | FULL), true);
    this.usb.indicateBufferReady(endpoint, false);
    if ((control & DATA1) === toggle) return data;
    this.count.toggleErrors++;
    return NAK;
  }

  out(endpoint, data, toggle) {
    const at = this.buffer(endpoint, true), control = at === null ? 0 : this.word(at);
    if (control & STALL) { this.count.stalls++; return STALLED; }
    if (!(control & AVAILABLE)) return NAK;
    if ((control & DATA1) !== toggle) { this.count.toggleErrors++; return data; }
    this.pico.chip.usbDPRAM.set(data, this.usb.getEndpointBufferOffset(endpoint, true));
    this.memory.setUint32(at, (control & ~(AVAILABLE | LENGTH)) | FULL | data.length, true);
    this.usb.indicateBufferReady(endpoint, true);
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
