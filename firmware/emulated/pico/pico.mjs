// A Raspberry Pi Pico: rp2040js with the chip's own boot ROM, and with what rp2040js lacks or does differently from the data sheet (UART
// with FIFOs, interrupts that latch, flash chip and its interface, a watchdog that resets, WFI with a pending interrupt).
//
// Shared with the driver's authors is only the data sheet. Not shown: electrical levels, analogue errors, and what depends on cycles; an
// instruction takes as long as rp2040js says.
import fs from 'node:fs';
import { RP2040 } from 'rp2040js';
import { Elf } from './elf.mjs';
import { Nor } from './nor.mjs';
import { Pl011 } from './pl011.mjs';
import { Registers } from './registers.mjs';
import { Ssi } from './ssi.mjs';

const FLASH = 0x10000000, FLASH_SIZE = 2 << 20, RAM = 0x20000000;
// The board's storage, in the metadata of firmware/Cargo.toml.
export const STORAGE = { start: FLASH_SIZE - (16 << 10), end: FLASH_SIZE };
const CACHE = 0x15000000, CACHE_SIZE = 16 << 10;
const CYCLE_NS = 8;
const UART_IRQS = [20, 21];
const SIO_GPIO_HI_IN = 0x008;
// QSPI pins that nothing pulls down; BOOTSEL pulls down the chip select.
const NOT_BOOTSEL = 0x3e, BOOTSEL = 0x3c;
const HAD_POWER_ON = 0x100, PSM_RESTART = 1 << 24;
// The mode of RTT that a debugger sets.
const LOG_WAITS = 2;
// Steps without time going by: the model is stuck.
const IDLE_LIMIT = 2e6;

export class Pico {
  // `isFlashed`: else the flash is as it comes from the factory, and the image is what it will be. `unknown` counts what rp2040js has no model of.
  constructor({ image, bootRom, uid = [1, 2, 3, 4, 5, 6, 7, 8], storage = null, isFlashed = true }) {
    this.elf = new Elf(image);
    const chip = (this.chip = new RP2040());
    this.clock = chip.clock;
    this.unknown = new Map();
    chip.logger = this.logger();
    this.nor = new Nor(chip, uid);
    this.ssi = new Ssi(chip, 'SSI', this.nor);
    this.uarts = UART_IRQS.map((irq, i) => new Pl011(chip, `UART${i}`, irq));
    this.resets = 0;
    this.instructions = 0;
    this.sleptNs = 0;
    this.idle = 0;
    this.onReset = null;
    // The button BOOTSEL.
    this.isPressed = false;
    // A computer at its USB connector, if there is one (usb.mjs).
    this.usb = null;
    this.wire();
    this.patchInterrupts();
    chip.bootrom.set(bootRom);
    if (isFlashed) this.flash();
    else this.leaveFactory();
    if (storage) chip.flash.set(storage, STORAGE.start);
    this.powerOn();
  }

  logger() {
    const note = (name, text) => {
      const key = `${name}: ${text}`;
      this.unknown.set(key, (this.unknown.get(key) ?? 0) + 1);
    };
    // rp2040js has no SEV but this line: it sets the event register, which lets the next WFE through.
    const info = (name, text) => { if (text === 'SEV') this.chip.core.eventRegistered = true; };
    return { debug() {}, info, warn: note, error: note };
  }

  wire() {
    const { chip, chip: { peripherals } } = this;
    peripherals[0x18000] = this.ssi;
    peripherals[0x14000] = new Registers(chip, 'XIP_CTRL', { 0: 3, 4: 1, 8: 6 }, (offset) => offset !== 0);
    peripherals[0x40018] = new Registers(chip, 'IO_QSPI', {}, (offset, value) => { if (offset === 0x0c) this.ssi.setPin(value); });
    [peripherals[0x40034], peripherals[0x40038]] = this.uarts;
    peripherals[0x40060] = new Registers(chip, 'ROSC', { 0x18: 0x80001000, 0x1c: 1 }, (offset) => offset === 0x18);
    peripherals[0x40064] = this.regulator = new Registers(chip, 'VREG', { 0: 0xb1, 4: 0x91, 8: HAD_POWER_ON }, (offset, value, self) => {
      if (offset !== 8) return false;
      if (value & PSM_RESTART) self.held[8] &= ~PSM_RESTART;
      return true;
    });
    const readSio = chip.sio.readUint32.bind(chip.sio);
    chip.sio.readUint32 = (offset) => (offset === SIO_GPIO_HI_IN ? (this.isPressed ? BOOTSEL : NOT_BOOTSEL) : readSio(offset));
    this.watchdog = peripherals[0x40058];
    this.watchdog.onWatchdogTrigger = () => {
      this.wantsReset = true;
      this.watchdog.alarm.enable = this.watchdog.timer.enable = false;
    };
  }

  flash() {
    for (const { address, bytes } of this.elf.segments()) {
      if (address < FLASH || address + bytes.length > FLASH + FLASH_SIZE) throw new Error(`a segment at 0x${address.toString(16)} is not in flash`);
      this.chip.flash.set(bytes, address - FLASH);
    }
  }

  // An erased flash; its cache is memory that the boot ROM's drive has its notes in, which rp2040js lacks.
  leaveFactory() {
    const { chip } = this, cache = new DataView(new ArrayBuffer(CACHE_SIZE));
    chip.flash.fill(0xff, 0, FLASH_SIZE);
    const read = chip.readUint32.bind(chip), write = chip.writeUint32.bind(chip), isCache = (address) => address >>> 14 === CACHE >>> 14;
    chip.readUint32 = (address) => (isCache(address) ? cache.getUint32(address - CACHE, true) : read(address));
    chip.writeUint32 = (address, value) => (isCache(address) ? cache.setUint32(address - CACHE, value, true) : write(address, value));
  }

  // ARMv6-M: an interrupt latches, its entry clears the latch, and a line that is still up at its return pends it again.
  patchInterrupts() {
    const { core } = this.chip;
    core.lines = 0;
    core.setInterrupt = (irq, up) => {
      const bit = 1 << irq;
      if (up && !(core.lines & bit)) {
        core.lines |= bit;
        core.pendingInterrupts |= bit;
        core.interruptsUpdated = true;
      }
      if (!up) core.lines &= ~bit;
    };
    const enter = core.exceptionEntry.bind(core), leave = core.exceptionReturn.bind(core);
    core.exceptionEntry = (number) => {
      if (number >= 16) core.pendingInterrupts &= ~(1 << (number - 16));
      enter(number);
    };
    core.exceptionReturn = (value) => {
      const number = core.IPSR;
      leave(value);
      if (number >= 16 && core.lines & (1 << (number - 16))) core.pendingInterrupts |= 1 << (number - 16);
      core.interruptsUpdated = true;
    };
  }

  powerOn() {
    this.regulator.reset();
    this.restart();
  }

  // What the watchdog resets when all but the oscillators are selected (PSM WDSEL): everything but RAM and the watchdog's scratch.
  restart() {
    const { chip, chip: { core, peripherals } } = this;
    this.uarts.forEach((uart) => uart.reset());
    this.usb?.deviceReset();
    this.ssi.reset();
    this.nor.selected = false;
    for (const base of [0x14000, 0x40018, 0x40060]) peripherals[base].reset();
    const timer = peripherals[0x40054];
    timer.intRaw = timer.intEnable = timer.intForce = 0;
    timer.alarms.forEach((alarm) => timer.disarmAlarm(alarm));
    Object.assign(core, { lines: 0, pendingInterrupts: 0, enabledInterrupts: 0, interruptPriorities: [0xffffffff, 0, 0, 0] });
    Object.assign(core, { PM: false, SPSEL: 0, nPRIV: false, currentMode: 0, IPSR: 0, VTOR: 0, waiting: false, eventRegistered: false, interruptsUpdated: false });
    chip.adc.cs = 0;
    chip.pwm.reset();
    for (const pin of chip.gpio) Object.assign(pin, { ctrl: 0x1f, padValue: 0b0110110 });
    this.watchdog.enable = this.watchdog.timer.enable = this.watchdog.alarm.enable = false;
    core.reset();
  }

  get now() { return this.clock.nanosCounter; }

  // Runs for so many ns; time stands where nothing would happen.
  runFor(nanos) { this.runUntil(this.now + nanos); }

  runUntil(end) {
    const { core } = this.chip;
    while (this.now < end) {
      if (this.wantsReset) this.reset();
      if (core.waiting) this.sleep(end);
      else {
        this.idle = 0;
        this.instructions++;
        this.clock.tick(core.executeInstruction() * CYCLE_NS);
      }
    }
  }

  reset() {
    this.wantsReset = false;
    this.resets++;
    this.onReset?.();
    this.restart();
  }

  sleep(end) {
    const { core } = this.chip, { clock } = this;
    if (core.pendingInterrupts & core.enabledInterrupts || core.pendingNMI || core.pendingSystick || core.pendingPendSV) {
      core.waiting = false;
      core.interruptsUpdated = true;
      return;
    }
    const wake = clock.nextAlarm?.nanos ?? Infinity, until = Math.min(wake, end);
    this.sleptNs += Math.max(0, until - this.now);
    if (wake <= end) {
      clock.nanosCounter = Math.max(this.now, wake);
      clock.tick(0);
    } else clock.tick(end - this.now);
    if (++this.idle > IDLE_LIMIT) throw new Error(`time stands still at ${this.now} ns`);
  }

  storage() { return this.chip.flash.slice(STORAGE.start, STORAGE.end); }

  // Puts code into the last bytes of RAM that nothing else uses, and jumps there.
  execute(...halfWords) {
    const { core, sramView } = this.chip, at = 0x41f00;
    halfWords.forEach((half, i) => sramView.setUint16(at + 2 * i, half, true));
    Object.assign(core, { PC: RAM + at, waiting: false, PM: false });
  }

  // The program hangs, while interrupts go on: "wfi; b .-2".
  hang() { this.execute(0xbf30, 0xe7fd); }

  // The program takes a hard fault, at an instruction that is none.
  fault() {
    const { core } = this.chip;
    this.chip.onBreak = () => { core.PC = RAM + 0x41f00; core.exceptionEntry(3); };
    this.execute(0xde00);
  }

  // Of the log (defmt over RTT): name, buffer, size, where it ends, where it is read, flags.
  get logChannel() { return this.elf.symbol('_SEGGER_RTT') - RAM + 24; }
  // Of its ring: size, where it ends, where it is read.
  logWords() { return [8, 12, 16].map((at) => this.chip.sramView.getUint32(this.logChannel + at, true)); }

  // A debugger has asked for a log that waits where there is no room, and was unplugged: there is none, and nobody reads.
  leaveDebugger() {
    const { sramView } = this.chip, [size, end] = this.logWords();
    sramView.setUint32(this.logChannel + 16, (end + 1) % size, true);
    sramView.setUint32(this.logChannel + 20, LOG_WAITS, true);
  }

  // What the log holds, as bytes for a decoder.
  log() {
    const { sramView, sram } = this.chip, channel = this.logChannel;
    const [buffer, size, end, start] = [4, 8, 12, 16].map((at) => sramView.getUint32(channel + at, true));
    const out = [];
    for (let at = start; at !== end; at = (at + 1) % size) out.push(sram[buffer - RAM + at]);
    sramView.setUint32(channel + 16, end, true);
    return Uint8Array.from(out);
  }
}

// The B1 boot ROM, as ./ci.sh setup has unpacked it: words, little endian.
export function bootRom(file) {
  const bytes = fs.readFileSync(file);
  return new Uint32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
}
