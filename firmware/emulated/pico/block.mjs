// A heated block at the pins of a Pico: the physics of firmware/src/bin/heater_emulated.rs. It is none that the node's model describes, and no
// two are alike. A conversion lets one tick pass, so that a run in lockstep is the same on a slow machine.
import { connectSensor, duty } from './pins.mjs';

// firmware/src/heater.rs: heater, K/s at full drive, and sensor, degrees C.
const FULL = 0.5, ZERO = -50, PER_COUNT = 330 / 4096;
const STEPS = 10;

// What may be wrong with a board, so that a test can show that it would be seen.
export const FAULTS = {
  none: (block) => block,
  // The converter gives for ever what it gave at first.
  stuck: (block) => { const first = block.counts; block.read = () => first; },
  // The heater's wire is off.
  unwired: (block) => { block.drive = () => 0; },
};

export class Block {
  // `which`: 0 to 2; `tick`: its period, s.
  constructor(pico, which, tick, fault = 'none') {
    this.celsius = 18 + 6 * which;
    this.full = FULL * (0.9 + 0.1 * which);
    this.loss = 0.014 - 0.004 * which;
    this.room = 15 + 5 * which;
    this.tick = tick;
    this.conversions = 0;
    this.drive = () => duty(pico);
    this.read = () => this.counts;
    FAULTS[fault](this);
    connectSensor(pico, () => this.converted());
  }

  get counts() { return Math.trunc((this.celsius - ZERO) / PER_COUNT); }

  converted() {
    this.conversions++;
    const heat = this.full * this.drive(), step = this.tick / STEPS;
    for (let i = 0; i < STEPS; i++) this.celsius += step * (heat - this.loss * (this.celsius - this.room));
    return this.read();
  }
}
