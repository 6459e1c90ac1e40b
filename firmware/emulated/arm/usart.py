"""Serial ports of STM32 chips: bytes that have come, in a FIFO where there is one, and bytes that go out at the line's speed. RM0440 (LPUART),
RM0390 (USART)."""

from core import Peripheral

FRAMING, NOISE, OVERRUN, IDLE, RECEIVED, COMPLETE, EMPTY = 1 << 1, 1 << 2, 1 << 3, 1 << 4, 1 << 5, 1 << 6, 1 << 7


class Usart(Peripheral):
    """What both kinds do; the places of their registers differ."""

    def __init__(self, core, base, irq, baud):
        super().__init__(core, base)
        self.irq, self.byte_ns, self.said = irq, 10e9 / baud, bytearray()
        self.on_byte = self.said.append

    def reset(self):
        super().reset()
        self.come, self.going, self.flags, self.sent_at = [], [], 0, None
        self.overruns = 0

    @property
    def depth(self):
        return 1

    @property
    def status(self):
        room = EMPTY if len(self.going) < self.depth else 0
        return self.flags | (RECEIVED if self.come else 0) | room | (0 if self.going else COMPLETE)

    def feed(self, byte, errors=0):
        """A byte has come, FRAMING or NOISE with it."""
        if not self.get(self.CR1) & self.ENABLE:
            return
        if len(self.come) >= self.depth:
            self.overruns += 1
            self.flags |= OVERRUN
        else:
            self.come.append((byte, errors))
            self.show()
        self.raise_line()

    def show(self):
        """Of all that have come the first one can be read, and its errors are shown."""
        if self.come:
            byte, errors = self.come[0]
            self.come[0] = byte, 0
            self.flags |= errors

    def pause(self):
        """The line has been idle for as long as a byte takes."""
        self.flags |= IDLE
        self.raise_line()

    def send(self, byte):
        self.going.append(byte)
        if self.sent_at is None:
            self.sent_at = self.core.ns + self.byte_ns

    def take(self):
        if not self.come:
            return 0
        byte, _ = self.come.pop(0)
        self.show()
        return byte

    def raise_line(self):
        enabled, status = self.get(self.CR1), self.status
        wanted = enabled & (IDLE | RECEIVED | COMPLETE | EMPTY)
        errors = OVERRUN if enabled & RECEIVED else 0
        if self.get(self.CR3) & 1:
            errors |= FRAMING | NOISE | OVERRUN
        self.core.irq(self.irq, bool(enabled & self.ENABLE and status & (wanted | errors)))

    def advance(self, before, after):
        while self.sent_at is not None and after >= self.sent_at:
            self.on_byte(self.going.pop(0))
            self.sent_at = self.sent_at + self.byte_ns if self.going else None
            self.raise_line()

    def next_event(self):
        return self.sent_at


class Lpuart(Usart):
    """The STM32G4's."""

    CR1, CR3, ISR, ICR, RDR, TDR, ENABLE = 0x00, 0x08, 0x1C, 0x20, 0x24, 0x28, 1
    ACKNOWLEDGED, FIFO_ENABLE, FIFO_DEPTH = 0x00600000, 1 << 29, 8

    @property
    def depth(self):
        return self.FIFO_DEPTH if self.get(self.CR1) & self.FIFO_ENABLE else 1

    def read(self, offset):
        if offset == self.ISR:
            return self.ACKNOWLEDGED | self.status
        if offset == self.RDR:
            byte = self.take()
            self.raise_line()
            return byte
        return self.get(offset)

    def write(self, offset, value):
        if offset == self.ICR:
            self.flags &= ~value
        elif offset == self.TDR:
            self.send(value & 0xFF)
        else:
            self.held[offset] = value
        self.raise_line()


class Usart2(Usart):
    """The STM32F4's: flags are cleared by reading the status, then the data."""

    SR, DR, CR1, CR3, ENABLE = 0x00, 0x04, 0x0C, 0x14, 1 << 13

    def read(self, offset):
        if offset == self.SR:
            return self.status
        if offset == self.DR:
            self.flags = 0
            byte = self.take()
            self.raise_line()
            return byte
        return self.get(offset)

    def write(self, offset, value):
        if offset == self.DR:
            self.send(value & 0xFF)
        elif offset != self.SR:
            self.held[offset] = value
        self.raise_line()
