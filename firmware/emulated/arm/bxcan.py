"""CAN 1 of the STM32F4 (RM0390, chapter 30): filter banks of FIFO 0, its three places, three mailboxes, bus-off.

Frames go out at once, as in fdcan.py. A DLC of 9 to 15 is kept as it came, as the chip does, with the eight bytes that such a frame has.
"""

import struct

from core import Peripheral
from fdcan import Frame, RECOVERY_NS

MCR, MSR, TSR, RF0R, IER, ESR, BTR = 0x00, 0x04, 0x08, 0x0C, 0x14, 0x18, 0x1C
MAILBOXES, RECEIVED, FM1R, FS1R, FFA1R, FA1R, BANKS = 0x180, 0x1B0, 0x204, 0x20C, 0x214, 0x21C, 0x240
BANK_COUNT, DEPTH = 14, 3
INRQ, SLEEP, ERROR = 1, 2, 4
# Of BTR: it hears itself; nothing of it is on the bus, and nothing on the bus reaches it.
LOOPED, SILENT = 1 << 30, 1 << 31
OVERRUN = 1 << 4
# Of IER: interrupts for the kind of the last error, and for errors at all. Of ESR: that kind; a form error, and what software writes.
LECIE, ERRIE = 1 << 11, 1 << 15
KIND, FORM = 7 << 4, 2 << 4
# Interrupts: mailbox empty, frame pending, errors.
TX_IRQ, RX0_IRQ, SCE_IRQ = 19, 20, 22


class BxCan(Peripheral):
    """The controller. `sent` is what it has put on the bus; `receive` gives it a frame."""

    # Whether a controller that is looped back hears itself.
    loops_back = True

    def __init__(self, core, base):
        super().__init__(core, base)
        self.sent, self.sent_at = [], []

    def reset(self):
        super().reset()
        self.held.update({MCR: 0x00010002, 0x200: 0x2A1C0E01})
        self.fifo, self.lost, self.refused, self.kind, self.flags = [], 0, 0, 0, 0
        self.is_off, self.recovers_at = False, None

    def read(self, offset):
        if offset == MSR:
            return self.get(MCR) & (INRQ | SLEEP) | self.flags
        if offset == TSR:
            return self.get(TSR) | 0x1C000000  # all mailboxes empty
        if offset == RF0R:
            return len(self.fifo) | (self.get(RF0R) & OVERRUN) | (8 if len(self.fifo) == DEPTH else 0)
        if offset == ESR:
            return self.kind | (248 << 16 | 7 if self.is_off else 0)
        if RECEIVED <= offset < RECEIVED + 16:
            return self.fifo[0][(offset - RECEIVED) // 4] if self.fifo else 0
        return self.get(offset)

    def write(self, offset, value):
        if offset == TSR:
            self.held[TSR] = self.get(TSR) & ~(value & 0x0F0F0F)
        elif offset == RF0R:
            if value & 0x20 and self.fifo:
                self.fifo.pop(0)
            if value & OVERRUN:
                self.held[RF0R] = 0
        elif offset == MSR:
            self.flags &= ~value
        elif offset == ESR:
            self.kind = value & KIND
        elif offset == MCR:
            self.leave_initialization(value)
        elif MAILBOXES <= offset < MAILBOXES + 48 and (offset - MAILBOXES) % 16 == 0 and value & 1:
            self.transmit((offset - MAILBOXES) // 16, value)
        else:
            self.held[offset] = value
        self.raise_lines()

    def leave_initialization(self, value):
        left = self.get(MCR) & INRQ and not value & INRQ
        if left and self.is_off:
            self.recovers_at = self.core.ns + RECOVERY_NS
        self.held[MCR] = value

    def raise_lines(self):
        enabled = self.get(IER)
        self.core.irq(TX_IRQ, bool(enabled & 1 and self.get(TSR) & 0x010101))
        self.core.irq(RX0_IRQ, bool(enabled & 2 and self.fifo or enabled & 8 and self.get(RF0R) & OVERRUN))
        self.core.irq(SCE_IRQ, bool(enabled & ERRIE and self.flags & ERROR))

    # --- sending

    def transmit(self, mailbox, identifier):
        if self.is_off:
            return
        at = MAILBOXES + 16 * mailbox
        length = self.get(at + 4) & 15
        data = struct.pack("<II", self.get(at + 8), self.get(at + 12))
        self.put(Frame(identifier >> 21, data[:length]))
        self.held[TSR] = self.get(TSR) | 0x03 << 8 * mailbox

    def put(self, frame):
        """A frame onto the bus, and to itself (RM0390, test mode)."""
        mode = self.get(BTR)
        if not mode & SILENT:
            self.sent_at.append(self.core.ns)
            self.sent.append(frame)
        if mode & LOOPED and self.loops_back:
            self.receive(frame)

    # --- receiving

    def accepts(self, frame):
        active, wide, lists, to_fifo_1 = (self.get(register) for register in (FA1R, FS1R, FM1R, FFA1R))
        return any(self.matches(frame, bank, wide >> bank & 1, lists >> bank & 1)
                   for bank in range(BANK_COUNT) if active >> bank & 1 and not to_fifo_1 >> bank & 1)

    def matches(self, frame, bank, is_wide, is_list):
        first, second = self.get(BANKS + 8 * bank), self.get(BANKS + 8 * bank + 4)
        if is_wide:
            word, fields = identifier(frame), [first, second]
        else:
            word = short_identifier(frame)
            fields = [first & 0xFFFF, first >> 16, second & 0xFFFF, second >> 16]
        if is_list:
            return word in fields
        return any(word & mask == value & mask for value, mask in zip(fields[::2], fields[1::2]))

    def receive(self, frame):
        if self.is_off or self.get(MCR) & (INRQ | SLEEP):
            return
        if not self.accepts(frame):
            self.refused += 1
            return
        if len(self.fifo) >= DEPTH:
            self.lost += 1
            self.held[RF0R] = OVERRUN
        else:
            code = frame.dlc if frame.dlc is not None else len(frame.data)
            self.fifo.append((identifier(frame), code, *struct.unpack("<II", (frame.data + bytes(8))[:8])))
        self.raise_lines()

    # --- errors

    def error(self):
        """A frame on the bus was broken; error counters stay low here. One of the same kind as the one before raises no other flag."""
        if self.kind != FORM and self.get(IER) & LECIE:
            self.flags |= ERROR
        self.kind = FORM
        self.raise_lines()

    def go_off(self):
        self.is_off = True

    def advance(self, before, after):
        if self.recovers_at is not None and after >= self.recovers_at:
            self.is_off, self.recovers_at = False, None

    def next_event(self):
        return self.recovers_at


def identifier(frame):
    """As in a filter of 32 bits and in the receive FIFO."""
    if frame.is_extended:
        return frame.id << 3 | 4 | frame.is_remote << 1
    return frame.id << 21 | frame.is_remote << 1


def short_identifier(frame):
    """As in a filter of 16 bits."""
    if frame.is_extended:
        return frame.id >> 18 << 5 | 8 | frame.is_remote << 4 | frame.id >> 15 & 7
    return frame.id << 5 | frame.is_remote << 4
