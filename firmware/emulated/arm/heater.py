"""A Nucleo-G474RE that heats a block: its converter and its PWM (RM0440), and the physics of firmware/src/bin/heater_emulated.rs, which are none that the node's model
describes; no two blocks are alike. A conversion lets one tick pass, so that a run in lockstep is the same on a slow machine."""

from core import Peripheral
from g474 import G474

# firmware/src/heater.rs: heater, K/s at full drive, and sensor, degrees C.
FULL, ZERO, PER_COUNT = 0.5, -50, 330 / 4096
STEPS = 10
SENSOR, HEATER = 1, 6


class Adc(Peripheral):
    """ADC 1: a conversion of the first channel of its sequence takes no time. `sample` gives the counts of a channel."""

    ISR, CR, SQR1, DR = 0x00, 0x08, 0x30, 0x40
    READY, END, END_OF_SEQUENCE = 1, 4, 8
    ENABLE, START, REGULATOR, DEEP, CALIBRATE = 1, 4, 1 << 28, 1 << 29, 1 << 31

    def __init__(self, core, base, sample):
        super().__init__(core, base)
        self.sample, self.faults = sample, []

    def reset(self):
        super().reset()
        self.held[self.CR] = self.DEEP
        self.is_calibrated = False

    def read(self, offset):
        if offset == self.DR:
            self.held[self.ISR] = self.get(self.ISR) & ~self.END
        return self.get(offset)

    def write(self, offset, value):
        if offset == self.ISR:  # cleared by ones
            self.held[offset] = self.get(offset) & ~value
        elif offset == self.CR:
            self.control(value)
        else:
            self.held[offset] = value

    def control(self, value):
        is_on = bool(self.get(self.CR) & self.ENABLE)
        if value & self.CALIBRATE:
            if is_on or not value & self.REGULATOR or value & self.DEEP:
                self.faults.append("calibrated while it is on, or without its regulator")
            self.is_calibrated = True
        if value & self.ENABLE and not is_on:
            self.held[self.ISR] = self.get(self.ISR) | self.READY
        # Only ADDIS switches it off.
        is_on = is_on or bool(value & self.ENABLE)
        self.held[self.CR] = value & ~(self.CALIBRATE | self.START) | is_on
        if value & self.START:
            self.convert(is_on)

    def convert(self, is_on):
        if not is_on or not self.is_calibrated:
            self.faults.append("a conversion without a calibration, or while it is off")
            return
        self.held[self.DR] = self.sample(self.get(self.SQR1) >> 6 & 31)
        self.held[self.ISR] = self.get(self.ISR) | self.END | self.END_OF_SEQUENCE


class Pwm(Peripheral):
    """TIM 3, by what its first channel gives."""

    CR1, CCMR1, CCER, ARR, CCR1, MODE_1 = 0x00, 0x18, 0x20, 0x2C, 0x34, 6

    @property
    def duty(self):
        """Share of the time, 0 to 1."""
        runs = self.get(self.CR1) & 1 and self.get(self.CCER) & 1 and self.get(self.CCMR1) >> 4 & 7 == self.MODE_1
        return min(self.get(self.CCR1) / (self.get(self.ARR) + 1), 1.0) if runs else 0.0


class Pins(Peripheral):
    """Port A: what drives a pin, and to where."""

    MODER, OTYPER, ODR, BSRR, AFRL, OUTPUT, ALTERNATE, OF_TIMER = 0x00, 0x04, 0x14, 0x18, 0x20, 1, 2, 2

    def reset(self):
        super().reset()
        # Pins are inputs without a way in; a debugger is at some.
        self.held[self.MODER] = 0xABFFFFFF

    def write(self, offset, value):
        if offset == self.BSRR:
            offset, value = self.ODR, self.get(self.ODR) & ~(value >> 16) | value & 0xFFFF
        self.held[offset] = value

    def level(self, pin, of_timer):
        """Of a pin, as a share of the time: an output, the timer's, or low by the pull-down on the board."""
        mode = self.get(self.MODER) >> 2 * pin & 3
        if mode == self.OUTPUT:
            return float(self.get(self.ODR) >> pin & 1)
        return of_timer if mode == self.ALTERNATE and self.get(self.AFRL) >> 4 * pin & 15 == self.OF_TIMER else 0.0


class Block:
    """A heated block. `drive` is what heats it, 0 to 1; `which` it is, 0 to 2; `tick` is its period, s."""

    def __init__(self, which, tick, drive):
        self.celsius, self.room = 18 + 6 * which, 15 + 5 * which
        self.full, self.loss = FULL * (0.9 + 0.1 * which), 0.014 - 0.004 * which
        self.tick, self.drive, self.conversions = tick, drive, 0

    @property
    def counts(self):
        return int((self.celsius - ZERO) / PER_COUNT)

    def converted(self):
        self.conversions += 1
        heat, step = self.full * self.drive(), self.tick / STEPS
        for _ in range(STEPS):
            self.celsius += step * (heat - self.loss * (self.celsius - self.room))
        return self.counts


def stuck(board):
    """The converter gives for ever what it gave at first."""
    first, convert = board.block.counts, board.block.converted
    board.adc.sample = lambda channel: (convert(), first)[1]


def unwired(board):
    """The heater's wire is off."""
    board.block.drive = lambda: 0.0


class Heater(G474):
    """The image `heater_g474`, with a block at its pins; of no other channel than its sensor's there are counts."""

    image = "heater_g474"

    def __init__(self, which=1, tick=0.1, **options):
        super().__init__(**options)
        self.pins = self.core.add(Pins(self.core, 0x48000000))
        self.pwm = self.core.add(Pwm(self.core, 0x40000400))
        self.block = Block(which, tick, lambda: self.duty)
        self.adc = self.core.add(Adc(self.core, 0x50000000, lambda channel: self.block.converted() if channel == SENSOR else 0))

    @property
    def duty(self):
        """What the heater has, 0 to 1."""
        return self.pins.level(HEATER, self.pwm.duty)
