"""What the STM32 boards share: the timer behind embassy's clock, pins, the independent watchdog, and the line that bytes come on.

From the reference manuals RM0440 and RM0390, and from what embassy's drivers touch: a reading of a manual that model and driver share is not
found out here.
"""

from core import Peripheral


class Timer(Peripheral):
    """TIM2 as embassy's clock uses it: an up-counter of 16 bits with compare interrupts."""

    CR1, DIER, SR, EGR, CNT, PSC, ARR = 0x00, 0x0C, 0x10, 0x14, 0x24, 0x28, 0x2C
    COMPARES = (0x34, 0x38, 0x3C, 0x40)
    IRQ = 28

    def __init__(self, core, base, hz):
        super().__init__(core, base)
        self.hz, self.begin, self.prescaler = hz, 0.0, 1

    def counts(self, ns):
        return int((ns - self.begin) * self.hz / 1e9 / self.prescaler)

    @property
    def period(self):
        return self.held.get(self.ARR, 0xFFFFFFFF) + 1

    def read(self, offset):
        return self.counts(self.core.ns) % self.period if offset == self.CNT else self.get(offset)

    def write(self, offset, value):
        if offset == self.SR:  # cleared by zeros
            self.held[offset] = self.get(offset) & value
        elif offset == self.EGR:
            self.generate(value)
        else:
            self.held[offset] = value
        self.raise_line()

    def generate(self, events):
        """Events by software: an update, and what a compare channel does."""
        flags = events & 0x1E
        if events & 1:
            self.begin, self.prescaler = self.core.ns, self.get(self.PSC) + 1
            # Update-request source: an update by software raises no flag.
            flags |= 0 if self.get(self.CR1) & 4 else 1
        self.held[self.SR] = self.get(self.SR) | flags

    def raise_line(self):
        self.core.irq(self.IRQ, bool(self.get(self.SR) & self.get(self.DIER) & 0x1F))

    def advance(self, before, after):
        if not self.get(self.CR1) & 1:
            return
        old, new = self.counts(before), self.counts(after)
        flags = 1 if new // self.period > old // self.period else 0
        for index, compare in enumerate(self.COMPARES):
            at = self.get(compare)
            if (new - at) // self.period > (old - at) // self.period:
                flags |= 2 << index
        if flags:
            self.held[self.SR] = self.get(self.SR) | flags
            self.raise_line()

    def next_event(self):
        now, enabled = self.counts(self.core.ns), self.get(self.DIER)
        waits = [(self.get(at) - now - 1) % self.period + 1 for i, at in enumerate(self.COMPARES) if enabled >> i + 1 & 1]
        waits += [self.period - now % self.period] if enabled & 1 else []
        return self.core.ns + min(waits) * 1e9 * self.prescaler / self.hz if waits else None


class Gpio(Peripheral):
    """Outputs of a port; `changes` counts those of pin PIN."""

    ODR, BSRR, PIN = 0x14, 0x18, 5

    def __init__(self, core, base):
        super().__init__(core, base)
        self.changes = 0

    def write(self, offset, value):
        if offset != self.BSRR:
            self.held[offset] = value
            return
        before = self.get(self.ODR)
        self.held[self.ODR] = before & ~(value >> 16) | value & 0xFFFF
        self.changes += (self.held[self.ODR] ^ before) >> self.PIN & 1


class Iwdg(Peripheral):
    """The independent watchdog: it counts from its start on, and resets the chip where nobody feeds it."""

    KR, PR, RLR = 0x00, 0x04, 0x08
    LSI_HZ = 32_000

    def reset(self):
        super().reset()
        self.held[self.RLR] = 0xFFF
        self.fed, self.longest = None, 0.0

    @property
    def period(self):
        return (self.get(self.RLR) + 1) * (4 << self.get(self.PR)) * 1e9 / self.LSI_HZ

    def write(self, offset, value):
        if offset != self.KR:
            self.held[offset] = value
        elif value == 0xCCCC or value == 0xAAAA and self.fed is not None:
            self.feed()

    def feed(self):
        if self.fed is not None:
            self.longest = max(self.longest, self.core.ns - self.fed)
        self.fed = self.core.ns

    def advance(self, before, after):
        if self.fed is not None and after - self.fed > self.period:
            self.core.is_barking = True

    def next_event(self):
        return None if self.fed is None else self.fed + self.period + 1000


class LineIn:
    """Bytes that come at the line's speed, one after the other."""

    def __init__(self, core, uart, baud):
        self.core, self.uart, self.byte_ns = core, uart, 10e9 / baud
        self.queue, self.at, self.has_paused = [], 0.0, True

    def push(self, data):
        if not self.queue:
            self.at = self.core.ns + self.byte_ns
        self.queue += data

    def next_event(self):
        return None if self.has_paused and not self.queue else self.at

    def deliver(self):
        """Whatever has come until now."""
        while self.queue and self.core.ns >= self.at:
            self.uart.feed(self.queue.pop(0))
            self.at += self.byte_ns
            self.has_paused = False
        if not self.queue and not self.has_paused and self.core.ns >= self.at:
            self.has_paused = True
            self.uart.pause()
