"""Peripherals of the nRF52840 that its images use (product specification): tasks, events, and the PPI that connects them."""

import collections

from core import Peripheral

EVENTS, INTEN, INTENSET, INTENCLR = 0x100, 0x300, 0x304, 0x308
PAGE = 0x1000


class NrfPeripheral(Peripheral):
    """Tasks from 0x000, events from 0x100, and an interrupt while an enabled event is set."""

    IRQ = None

    def __init__(self, core, base):
        super().__init__(core, base, PAGE)

    def read(self, offset):
        return self.get(INTEN) if offset in (INTENSET, INTENCLR) else self.get(offset)

    def write(self, offset, value):
        if offset < EVENTS:
            if value & 1:
                self.task(offset)
        elif offset == INTENSET:
            self.held[INTEN] = self.get(INTEN) | value
        elif offset == INTENCLR:
            self.held[INTEN] = self.get(INTEN) & ~value
        else:
            self.held[offset] = value
        self.raise_line()

    def task(self, offset):
        """What a task does."""

    def fire(self, offset):
        """An event has happened."""
        self.held[offset] = 1
        self.core.ppi.on_event(self.base + offset)
        self.raise_line()

    def raise_line(self):
        if self.IRQ is not None:
            enabled = self.get(INTEN)
            self.core.irq(self.IRQ, any(enabled >> bit & 1 and self.get(EVENTS + 4 * bit) for bit in range(32)))


class Clock(NrfPeripheral):
    """CLOCK and POWER: crystals that run at once where they are there, and the cause of the last reset."""

    IRQ = 0
    HFCLKSTAT, LFCLKSTAT, RESETREAS = 0x40C, 0x418, 0x400
    CAUSES = {"power": 0, "reset request": 1 << 2, "watchdog": 1 << 1}
    cause = 0
    # Whether the board has its crystals; the chip's own oscillators are always there.
    has_fast_crystal = has_slow_crystal = True
    LFCLKSRC, XTAL = 0x518, 1

    def read(self, offset):
        if offset == self.RESETREAS:
            return self.cause
        return 0x10001 if offset in (self.HFCLKSTAT, self.LFCLKSTAT) else super().read(offset)

    def write(self, offset, value):
        if offset == self.RESETREAS:
            self.cause &= ~value
        else:
            super().write(offset, value)

    def task(self, offset):
        if offset == 0x000 and self.has_fast_crystal:
            self.fire(0x100)
        elif offset == 0x008 and (self.has_slow_crystal or self.get(self.LFCLKSRC) & 3 != self.XTAL):
            self.fire(0x104)


class Ppi(NrfPeripheral):
    """Channels from events to tasks, and groups of channels that tasks enable and disable."""

    CHEN, CHENSET, CHENCLR, CHANNELS, GROUPS, FORKS, COUNT = 0x500, 0x504, 0x508, 0x510, 0x800, 0x910, 20

    def read(self, offset):
        return self.get(self.CHEN) if offset in (self.CHENSET, self.CHENCLR) else self.get(offset)

    def write(self, offset, value):
        if offset == self.CHENSET:
            self.held[self.CHEN] = self.get(self.CHEN) | value
        elif offset == self.CHENCLR:
            self.held[self.CHEN] = self.get(self.CHEN) & ~value
        else:
            super().write(offset, value)

    def task(self, offset):
        channels, enables = self.get(self.GROUPS + offset // 8 * 4), offset & 4 == 0
        enabled = self.get(self.CHEN)
        self.held[self.CHEN] = enabled | channels if enables else enabled & ~channels

    def on_event(self, address):
        for channel in range(self.COUNT):
            if self.get(self.CHEN) >> channel & 1 and self.get(self.CHANNELS + 8 * channel) == address:
                for task in (self.get(self.CHANNELS + 8 * channel + 4), self.get(self.FORKS + 4 * channel)):
                    if task:
                        self.core.run_task(task)


class Counter(NrfPeripheral):
    """A TIMER that counts events, as the buffered UARTE's driver uses it, with the shortcuts COMPARE to CLEAR."""

    IRQ = 8
    COUNT, CLEAR, CAPTURE, SHORTS, COMPARE, CC = 0x008, 0x00C, 0x040, 0x200, 0x140, 0x540

    def reset(self):
        super().reset()
        self.count = 0

    def task(self, offset):
        if offset == self.COUNT:
            self.count_one()
        elif offset == self.CLEAR:
            self.count = 0
        elif self.CAPTURE <= offset < self.CAPTURE + 24:
            self.held[self.CC + offset - self.CAPTURE] = self.count

    def count_one(self):
        self.count += 1
        reached = [i for i in range(6) if self.count == self.get(self.CC + 4 * i)]
        if any(self.get(self.SHORTS) >> i & 1 for i in reached):
            self.count = 0
        for i in reached:
            self.fire(self.COMPARE + 4 * i)


class Microseconds(NrfPeripheral):
    """A TIMER that counts time, in steps of 2^PRESCALER periods of 16 MHz, and shows its count where it is captured."""

    HZ = 16_000_000
    START, STOP, CLEAR, CAPTURE, BITMODE, PRESCALER, CC = 0x000, 0x004, 0x00C, 0x040, 0x508, 0x510, 0x540
    BITS = 16, 8, 24, 32

    def reset(self):
        super().reset()
        self.held[self.PRESCALER] = 4
        self.begin = None

    @property
    def count(self):
        if self.begin is None:
            return 0
        counts = int((self.core.time - self.begin) * self.HZ / 1e9) >> self.get(self.PRESCALER)
        return counts % (1 << self.BITS[self.get(self.BITMODE)])

    def task(self, offset):
        if offset == self.CLEAR and self.begin is not None or offset == self.START and self.begin is None:
            self.begin = self.core.ns
        elif self.CAPTURE <= offset < self.CAPTURE + 24:
            self.held[self.CC + offset - self.CAPTURE] = self.count


class Uarte(NrfPeripheral):
    """A UART with EasyDMA: pointers are latched at the start, six bytes wait while no reception runs, and more are an overrun."""

    FIFO = 6
    STARTRX, STOPRX, STARTTX, STOPTX = 0x000, 0x004, 0x008, 0x00C
    RXDRDY, ENDRX, ENDTX, ERROR, RXTO, RXSTARTED, TXSTARTED, TXSTOPPED = 0x108, 0x110, 0x120, 0x124, 0x144, 0x14C, 0x150, 0x158
    ERRORSRC, RX_PTR, RX_MAXCNT, RX_AMOUNT, TX_PTR, TX_MAXCNT, TX_AMOUNT = 0x480, 0x534, 0x538, 0x53C, 0x544, 0x548, 0x54C

    def __init__(self, core, base, irq, baud):
        super().__init__(core, base)
        self.IRQ = irq
        self.byte_ns, self.said = 10e9 / baud, bytearray()
        self.on_byte = self.said.append

    def reset(self):
        super().reset()
        self.fifo, self.running, self.sent_at = collections.deque(), None, None
        self.byte_at = 0.0
        self.overruns = 0

    def task(self, offset):
        if offset == self.STARTRX:
            self.running = [self.get(self.RX_PTR), self.get(self.RX_MAXCNT), 0]
            self.fire(self.RXSTARTED)
            while self.fifo and self.running:
                self.feed(self.fifo.popleft())
        elif offset == self.STOPRX:
            self.running = None
            self.fire(self.RXTO)
        elif offset == self.STARTTX:
            self.transmit(self.get(self.TX_PTR), self.get(self.TX_MAXCNT))
        elif offset == self.STOPTX:
            self.fire(self.TXSTOPPED)

    def transmit(self, pointer, count):
        self.sending = bytes(self.core.uc.mem_read(pointer, count))
        self.held[self.TX_AMOUNT] = count
        self.sent_at = self.core.ns + count * self.byte_ns
        self.fire(self.TXSTARTED)

    def feed(self, byte):
        """A byte has come."""
        if self.running:
            pointer, most, count = self.running
            self.core.uc.mem_write(pointer + count, bytes([byte]))
            self.running[2] += 1
            self.fire(self.RXDRDY)
            if self.running[2] == most:
                self.held[self.RX_AMOUNT], self.running = most, None
                self.fire(self.ENDRX)
        elif len(self.fifo) < self.FIFO:
            self.fifo.append(byte)
        else:
            self.overruns += 1
            self.held[self.ERRORSRC] = self.get(self.ERRORSRC) | 1
            self.fire(self.ERROR)

    def pause(self):
        """An idle line is no event here."""

    def write(self, offset, value):
        if offset == self.ERRORSRC:
            self.held[offset] = self.get(offset) & ~value
        else:
            super().write(offset, value)

    def advance(self, before, after):
        if self.sent_at is not None and after >= self.sent_at:
            first, self.sent_at = self.sent_at - len(self.sending) * self.byte_ns, None
            for count, byte in enumerate(self.sending, 1):
                # When it has left, ns.
                self.byte_at = first + count * self.byte_ns
                self.on_byte(byte)
            self.fire(self.ENDTX)

    def next_event(self):
        return self.sent_at


class Gpio(NrfPeripheral):
    """Outputs of port 1; `changes` counts those of pin PIN."""

    OUTSET, OUTCLR, PIN = 0x808, 0x80C, 3

    def __init__(self, core, base):
        super().__init__(core, base)
        self.changes, self.out = 0, 0

    def write(self, offset, value):
        before = self.out
        self.out |= value if offset == self.OUTSET else 0
        self.out &= ~value if offset == self.OUTCLR else -1
        self.changes += (self.out ^ before) >> self.PIN & 1
        self.held[offset] = value


class Rtc(NrfPeripheral):
    """RTC 1 at 32,768 Hz: embassy's clock."""

    IRQ = 17
    START, CLEAR, OVERFLOW, COMPARE, COUNTER, CC, HZ, BITS = 0x000, 0x008, 0x104, 0x140, 0x504, 0x540, 32_768, 24

    def reset(self):
        super().reset()
        self.begin = None

    def task(self, offset):
        if offset == self.CLEAR or offset == self.START and self.begin is None:
            self.begin = self.core.ns

    def counts(self, ns):
        return 0 if self.begin is None else int((ns - self.begin) * self.HZ / 1e9)

    def read(self, offset):
        return self.counts(self.core.ns) & 0xFFFFFF if offset == self.COUNTER else super().read(offset)

    def advance(self, before, after):
        if self.begin is None:
            return
        old, new = self.counts(before), self.counts(after)
        for i in range(4):
            compare = self.get(self.CC + 4 * i) & 0xFFFFFF
            if new - compare >> self.BITS != old - compare >> self.BITS:
                self.fire(self.COMPARE + 4 * i)
        if new >> self.BITS != old >> self.BITS:
            self.fire(self.OVERFLOW)

    def next_event(self):
        if self.begin is None:
            return None
        now, enabled = self.counts(self.core.ns), self.get(INTEN)
        waits = [(self.get(self.CC + 4 * i) - now - 1) % (1 << self.BITS) + 1 for i in range(4) if enabled >> 16 + i & 1]
        waits += [(1 << self.BITS) - now % (1 << self.BITS)] if enabled & 2 else []
        return self.begin + (now + min(waits)) * 1e9 / self.HZ + 1 if waits else None


class Wdt(NrfPeripheral):
    """The watchdog: it counts at 32,768 Hz from its start on."""

    START, RUNSTATUS, REQSTATUS, CRV, RR0, RELOAD = 0x000, 0x400, 0x404, 0x504, 0x600, 0x6E524635

    def reset(self):
        super().reset()
        self.fed, self.longest = None, 0.0

    def task(self, offset):
        if offset == self.START:
            self.fed = self.core.ns

    def read(self, offset):
        return {self.RUNSTATUS: int(self.fed is not None), self.REQSTATUS: 1}.get(offset, super().read(offset))

    def write(self, offset, value):
        super().write(offset, value)
        if offset == self.RR0 and value == self.RELOAD and self.fed is not None:
            self.longest, self.fed = max(self.longest, self.core.ns - self.fed), self.core.ns

    def advance(self, before, after):
        if self.fed is not None and after > self.next_event():
            self.core.is_barking = True

    def next_event(self):
        return None if self.fed is None else self.fed + (self.get(self.CRV) + 1) * 1e9 / 32_768


class Nvmc(NrfPeripheral):
    """The flash: words, pages of 4 KiB; the core stands still while it erases. Its power can be cut at any operation."""

    READY, READY_NEXT, CONFIG, ERASEPAGE, WRITES = 0x400, 0x408, 0x504, 0x508, 1
    ERASE_NS = 85e6
    # A word takes no time here, unless it is asked for.
    program_ns = 0

    def __init__(self, core, base):
        super().__init__(core, base)
        self.operations, self.cut_at, self.unfinished, self.faults, self.broken = 0, None, None, [], set()
        self.erase_ns = self.ERASE_NS
        core.on_flash_write(self.on_write)

    def read(self, offset):
        return 1 if offset in (self.READY, self.READY_NEXT) else super().read(offset)

    def write(self, offset, value):
        if offset == self.ERASEPAGE:
            self.wipe(value, self.perform(PAGE))
            self.core.stall(self.erase_ns)
        else:
            super().write(offset, value)

    def wipe(self, start, size):
        self.core.uc.mem_write(start, b"\xff" * size)

    def on_write(self, uc, access, address, size, value, data):
        old = int.from_bytes(uc.mem_read(address, 4), "little")
        if self.get(self.CONFIG) != self.WRITES or size != 4 or old & value & 0xFFFFFFFF != value & 0xFFFFFFFF:
            self.faults.append(f"a write of {size} bytes at {address:#x}, where {old:#x} is")
            return
        part = self.perform(size)
        self.unfinished = (address, part, old) if self.is_cut else None
        self.core.stall(self.program_ns)

    def perform(self, size):
        self.is_cut = self.cut_at is not None and self.operations == self.cut_at[0]
        self.operations += 1
        if self.is_cut:
            self.core.stop("power cut")
        return int(size * self.cut_at[1]) if self.is_cut else size

    def settle(self):
        """After a cut: of the word that was being written, a part."""
        if self.unfinished:
            address, part, old = self.unfinished
            self.core.uc.mem_write(address + part, old.to_bytes(4, "little")[part:])
