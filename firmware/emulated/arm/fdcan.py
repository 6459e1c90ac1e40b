"""FDCAN 1 of the STM32G4 (RM0440, chapter 44; Bosch M_CAN): filters, both receive FIFOs' first one, transmit FIFO, bus-off.

Frames go out at once. There are no bits on this bus: no arbitration, no timing, no errors but those that a test makes.
"""

import collections
import struct

from core import Peripheral

Frame = collections.namedtuple("Frame", "id data is_extended is_remote dlc is_fd", defaults=(False, False, None, False))
LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
# Message RAM: filters of 11 and 29 bits, receive FIFO 0, transmit buffers.
STANDARD, EXTENDED, FIFO, TRANSMIT = 0x000, 0x070, 0x0B0, 0x278
ELEMENT, DEPTH = 72, 3
NEW_MESSAGE, LOST, TRANSMITTED, BUS_OFF = 1 << 0, 1 << 2, 1 << 7, 1 << 19
RECOVERY_NS = 129 * 11e3
IRQ = 21


class MessageRam(Peripheral):
    """1 KiB of words."""


class Fdcan(Peripheral):
    """The controller. `sent` is what it has put on the bus; `receive` gives it a frame."""

    CREL, ENDN, CCCR, ECR, PSR, IR, IE, ILE, RXGFC, RXF0S, RXF0A = 0x00, 0x04, 0x18, 0x40, 0x44, 0x50, 0x54, 0x5C, 0x80, 0x90, 0x94
    TXFQS, TXBAR, TEST = 0xC4, 0xCC, 0x10
    # TEST.LBCK; CCCR.TEST without which it is not asked; CCCR.MON, with which nothing is on the bus.
    LOOPED, TESTS, MONITORS = 1 << 4, 1 << 7, 1 << 5
    # Whether a controller that is looped back hears itself.
    loops_back = True

    def __init__(self, core, base, ram_base):
        super().__init__(core, base)
        self.ram = core.add(MessageRam(core, ram_base))
        self.sent, self.sent_at = [], []

    def reset(self):
        super().reset()
        self.held[self.CCCR] = 1
        self.fifo, self.put, self.lost, self.refused = [], 0, 0, 0
        self.is_off, self.recovers_at, self.errors = False, None, 0

    def read(self, offset):
        if offset == self.ECR:
            # CEL, the number of errors on the bus, begins anew with each reading.
            logged, self.errors = min(self.errors, 255), 0
            return logged << 16 | (248 if self.is_off else 0)
        if offset == self.RXF0S:
            return len(self.fifo) | (self.fifo[0] << 8 if self.fifo else 0) | self.put << 16
        return {
            self.CREL: 0x32141218, self.ENDN: 0x87654321,
            self.PSR: 0x707 | (0xE0 if self.is_off else 0), self.TXFQS: DEPTH,
        }.get(offset, self.get(offset))

    def write(self, offset, value):
        if offset == self.IR:  # cleared by ones
            self.held[offset] = self.get(offset) & ~value
        elif offset == self.RXF0A:
            if self.fifo:
                self.fifo.pop(0)
        elif offset == self.TXBAR:
            self.transmit(value)
        elif offset == self.CCCR:
            if self.is_off and not value & 1:
                self.recovers_at = self.core.ns + RECOVERY_NS
            self.held[offset] = value
        else:
            self.held[offset] = value
        self.raise_line()

    def raise_line(self):
        self.core.irq(IRQ, bool(self.get(self.IR) & self.get(self.IE) and self.get(self.ILE) & 1))

    def flag(self, flag):
        self.held[self.IR] = self.get(self.IR) | flag
        self.raise_line()

    # --- sending

    def transmit(self, buffers):
        for index in range(DEPTH):
            if buffers >> index & 1 and not self.is_off:
                words = [self.ram.get(TRANSMIT + ELEMENT * index + 4 * word) for word in range(18)]
                length = LENGTHS[words[1] >> 16 & 15]
                self.go(Frame(words[0] >> 18 & 0x7FF, struct.pack("<16I", *words[2:])[:length], is_fd=bool(words[1] >> 21 & 1)))
        self.flag(TRANSMITTED)

    def go(self, frame):
        """A frame onto the bus, and to itself (RM0440, test modes)."""
        control = self.get(self.CCCR)
        if not control & self.MONITORS:
            self.sent_at.append(self.core.ns)
            self.sent.append(frame)
        if control & self.TESTS and self.get(self.TEST) & self.LOOPED and self.loops_back:
            self.receive(frame)

    # --- receiving

    def accepts(self, frame):
        """What the filters say (RM0440, global filter and filter elements)."""
        rules = self.get(self.RXGFC)
        reject_remote, non_matching = (rules >> 0 & 1, rules >> 2 & 3) if frame.is_extended else (rules >> 1 & 1, rules >> 4 & 3)
        if frame.is_remote and reject_remote:
            return False
        count = rules >> 24 & 15 if frame.is_extended else rules >> 16 & 31
        for index in range(count):
            action = self.matching(frame, index)
            if action is not None:
                return action == 1
        return non_matching == 0

    def matching(self, frame, index):
        """What filter `index` does with a frame (1: into FIFO 0); None where it does not match."""
        if frame.is_extended:
            first, second = (self.ram.get(EXTENDED + 8 * index + 4 * word) for word in range(2))
            kind, action, low, high = second >> 30, first >> 29, first & 0x1FFFFFFF, second & 0x1FFFFFFF
        else:
            word = self.ram.get(STANDARD + 4 * index)
            kind, action, low, high = word >> 30, word >> 27 & 7, word >> 16 & 0x7FF, word & 0x7FF
            kind = {3: None}.get(kind, kind)
        matches = {0: low <= frame.id <= high, 1: frame.id in (low, high), 2: frame.id & high == low & high}.get(kind, False)
        return action if matches and action else None

    def receive(self, frame):
        if self.is_off or self.get(self.CCCR) & 1:
            return
        if not self.accepts(frame):
            self.refused += 1
            return
        if len(self.fifo) >= DEPTH:
            self.lost += 1
            self.flag(LOST)
            return
        at = FIFO + ELEMENT * self.put
        code = frame.dlc if frame.dlc is not None else LENGTHS.index(len(frame.data))
        self.ram.held[at] = (1 << 30 | frame.id if frame.is_extended else frame.id << 18) | frame.is_remote << 29
        self.ram.held[at + 4] = code << 16 | (3 << 20 if frame.is_fd else 0)
        data = (frame.data + bytes(64))[:64]
        for word, value in enumerate(struct.unpack("<16I", data)):
            self.ram.held[at + 8 + 4 * word] = value
        self.fifo.append(self.put)
        self.put = (self.put + 1) % DEPTH
        self.flag(NEW_MESSAGE)

    # --- errors

    def error(self):
        """A frame on the bus was broken; error counters stay low here."""
        self.errors += 1

    def go_off(self):
        """As after 32 frames that could not be sent."""
        self.is_off = True
        self.held[self.CCCR] = self.get(self.CCCR) | 1
        self.flag(BUS_OFF)

    def advance(self, before, after):
        if self.recovers_at is not None and after >= self.recovers_at:
            self.is_off, self.recovers_at = False, None

    def next_event(self):
        return self.recovers_at
