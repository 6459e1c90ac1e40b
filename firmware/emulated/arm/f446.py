"""The Nucleo-F446RE: what its image touches of an STM32F446RE (RM0390)."""

from board import Board
from bxcan import BxCan
from check import Check
from core import Core, Peripheral
from stm32 import Gpio, Iwdg, Timer
from usart import Usart2

FLASH, FLASH_SIZE = 0x08000000, 512 << 10
SECTOR = 16 << 10
STORAGE = 0x08004000, 32 << 10
INFORMATION = 0x1FFF0000, 0x10000
UID = 0x1FFF7A10
HZ, TIMER_HZ, BAUD = 160_000_000, 80_000_000, 115_200
ERASE_NS = 250e6
# Half of what the timer of embassy's clock counts before it begins anew: it interrupts each time.
HALF_NS = 32_768e3
BOOT_MS = 10
# What a look at a clock that is missing, and one at flash that is busy, takes: longer than on the chip, so that a wait does not take all day.
POLL_NS, ERASE_POLL_NS = 10e3, 50e3


class Rcc(Peripheral):
    """Clocks that are ready as soon as they are on, and the cause of the last reset."""

    CR, CFGR, CSR = 0x00, 0x08, 0x74
    CAUSES = {"power": 7 << 25, "reset request": 1 << 28 | 1 << 26, "watchdog": 1 << 29 | 1 << 26}
    CLEAR = 1 << 24
    cause = CAUSES["power"]
    # Whether the crystal, or what stands for it, is there.
    has_crystal = True

    def read(self, offset):
        held = self.get(offset)
        if offset == self.CR:
            if not self.has_crystal:
                held &= ~0x10000
                self.core.stall(POLL_NS)
            return held & ~0x02020002 | (held & 0x10000) << 1 | (held & 0x01000000) << 1 | (held & 1) << 1 | 3
        if offset == self.CFGR:
            return held & ~0xC | (held & 3) << 2
        if offset == self.CSR:
            return held | self.cause | (held & 1) << 1
        return held

    def write(self, offset, value):
        if offset == self.CSR and value & self.CLEAR:
            self.cause = 0
            value &= ~self.CLEAR
        self.held[offset] = value & 0xFFFFFF if offset == self.CSR else value


class Pwr(Peripheral):
    """A regulator that is ready."""

    CSR = 0x04

    def read(self, offset):
        return self.get(offset) | (0x34000 if offset == self.CSR else 0)


class Flash(Peripheral):
    """The flash interface: bytes, sectors, one bank; the core stands still while it erases, which a look at BUSY stands for. Its power can be
    cut at any operation. Its data cache may hold what was there before an erase until it is emptied; that is a fault, not a value."""

    ACR, KEYR, SR, CR = 0x00, 0x04, 0x0C, 0x10
    PROGRAM, ERASE, START, LOCK, BUSY = 1, 2, 1 << 16, 1 << 31, 1 << 16
    PREFETCH, INSTRUCTIONS, DATA, EMPTY_DATA = 1 << 8, 1 << 9, 1 << 10, 1 << 12
    KEY = 0xCDEF89AB

    def __init__(self, core, base):
        super().__init__(core, base)
        self.operations, self.cut_at, self.unfinished, self.faults, self.broken = 0, None, None, [], set()
        # A word takes no time here, unless it is asked for.
        self.erase_ns, self.program_ns = ERASE_NS, 0
        core.on_flash_write(self.on_write)

    def reset(self):
        super().reset()
        self.held[self.CR] = self.LOCK
        self.busy_until, self.is_stale = 0.0, False

    def read(self, offset):
        is_busy = offset == self.SR and self.core.time < self.busy_until
        if is_busy:
            self.core.stall(min(ERASE_POLL_NS, self.busy_until - self.core.time))
        return self.get(offset) | (self.BUSY if is_busy else 0)

    def write(self, offset, value):
        if offset == self.ACR:
            self.access(value)
        elif offset == self.KEYR:
            if value == self.KEY:
                self.held[self.CR] &= ~self.LOCK
        elif offset == self.SR:
            self.held[offset] = self.get(offset) & ~value
        elif offset == self.CR:
            if not self.get(self.CR) & self.LOCK:
                self.control(value)
        else:
            self.held[offset] = value

    def access(self, value):
        if value & self.EMPTY_DATA:
            if self.get(self.ACR) & self.DATA:
                self.faults.append("the data cache is emptied while it is on")
            self.is_stale = False
        if value & self.DATA and self.is_stale:
            self.faults.append("the data cache is on and not emptied after an erase")
        self.held[self.ACR] = value

    def control(self, value):
        self.held[self.CR] = value & ~self.START
        if value & self.START and value & self.ERASE:
            self.erase(value >> 3 & 15)

    def erase(self, sector):
        if sector > 3:
            self.faults.append(f"sector {sector} has 64 KiB or more")
            return
        if self.get(self.ACR) & self.DATA:
            self.faults.append(f"sector {sector} is erased behind the data cache")
        self.is_stale = True
        part = self.perform(SECTOR)
        self.wipe(FLASH + sector * SECTOR, part)
        self.busy_until = self.core.time + self.erase_ns

    def wipe(self, start, size):
        self.core.uc.mem_write(start, b"\xff" * size)

    def on_write(self, uc, access, address, size, value, data):
        if not self.get(self.CR) & self.PROGRAM:
            self.faults.append(f"a write at {address:#x} that is no programming")
            return
        if self.get(self.CR) >> 8 & 3 != (size.bit_length() - 1):
            self.faults.append(f"a write of {size} bytes at {address:#x} with another PSIZE")
        old = int.from_bytes(uc.mem_read(address, size), "little")
        if old & value != value & ((1 << 8 * size) - 1):
            self.faults.append(f"the {size} bytes at {address:#x} are not erased")
        self.unfinished = address, size, self.perform(size)
        if self.unfinished[2] == size and not self.is_cut:
            self.unfinished = None
        self.busy_until = self.core.time + self.program_ns

    def perform(self, size):
        self.is_cut = self.cut_at is not None and self.operations == self.cut_at[0]
        self.operations += 1
        if self.is_cut:
            self.core.stop("power cut")
        return int(size * self.cut_at[1]) if self.is_cut else size

    def settle(self):
        """After a cut: of what was being programmed, a part."""
        if self.unfinished:
            address, size, part = self.unfinished
            self.core.uc.mem_write(address + part, b"\xff" * (size - part))


class Dwt(Peripheral):
    """The core's counter of cycles, which goes on while the core stands still."""

    CTRL, CYCCNT = 0x00, 0x04

    def read(self, offset):
        if offset == self.CYCCNT:
            return int(self.core.time * HZ / 1e9) if self.get(self.CTRL) & 1 else 0
        return self.get(offset)


class F446(Board):
    """A node on a Nucleo-F446RE."""

    image, boot_ms, storage_at = "nucleo_f446re", BOOT_MS, STORAGE

    def __init__(self, image=None, serial=1, storage=None, broken=()):
        core = Core(self.path(image), HZ, FLASH, FLASH_SIZE, 128 << 10, [INFORMATION])
        core.uc.mem_write(UID, bytes(range(1, 12)) + bytes([serial]))
        core.uc.mem_write(0x1FFF7A22, (512).to_bytes(2, "little"))
        self.rcc = core.add(Rcc(core, 0x40023800))
        core.add(Pwr(core, 0x40007000))
        self.flash = core.add(Flash(core, 0x40023C00))
        self.timer = core.add(Timer(core, 0x40000000, TIMER_HZ))
        self.watchdog = core.add(Iwdg(core, 0x40003000))
        core.add(Dwt(core, 0xE0001000))
        self.can = core.add(BxCan(core, 0x40006400))
        super().__init__(core, core.add(Usart2(core, 0x40004400, 38, BAUD)), BAUD, storage)


class F446Check(Check, F446):
    """The image that checks its board: a wire from the TX of USART 1 to its RX, and alarms by TIM 2. A word takes what the data sheet calls typical."""

    image, alarms = "board_check_f446", Timer.IRQ

    def __init__(self, storage=None, **options):
        super().__init__(storage=storage)
        self.flash.program_ns = 16e3
        self.pins = self.core.add(Gpio(self.core, 0x40020000))
        self.connect(self.core.add(Usart2(self.core, 0x40011000, 37, self.echo_baud)), **options)

    def take_number(self):
        self.core.uc.mem_write(UID, bytes(12))
