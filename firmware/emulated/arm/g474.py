"""The Nucleo-G474RE: what its images touch of an STM32G474RE (RM0440)."""

from board import Board
from check import Check
from core import Core, Peripheral
from fdcan import Fdcan
from stm32 import Gpio, Iwdg, Timer
from usart import Lpuart
from unicorn import UC_HOOK_MEM_READ
from unicorn.arm_const import UC_ARM_REG_XPSR

FLASH, FLASH_SIZE, BANK, PAGE = 0x08000000, 512 << 10, 256 << 10, 2 << 10
STORAGE = 0x0807E000, 8 << 10
INFORMATION = 0x1FFF0000, 0x10000
UID = 0x1FFF7590
HZ, BAUD = 160_000_000, 115_200
ERASE_NS = 22e6
BOOT_MS = 10
# What a look at a clock that is missing, or at flash that is busy, takes: longer than on the chip, so that a wait does not take all day.
POLL_NS = 10e3
# Where XPSR holds how far an IT block has come.
IT_STATE = 0x0600FC00


class Rcc(Peripheral):
    """Clocks that are ready as soon as they are on, and the cause of the last reset."""

    CR, CFGR, CSR, CRRCR = 0x00, 0x08, 0x94, 0x98
    CAUSES = {"power": 1 << 27 | 1 << 26, "reset request": 1 << 28 | 1 << 26, "watchdog": 1 << 29 | 1 << 26}
    CLEAR = 1 << 23
    cause = CAUSES["power"]
    # Whether the crystal, or what stands for it, is there.
    has_crystal = True

    def read(self, offset):
        held = self.get(offset)
        if offset == self.CR:
            if not self.has_crystal:
                held &= ~0x10000
                self.core.stall(POLL_NS)
            return held & ~0x0A020400 | (held & 0x100) << 2 | (held & 0x10000) << 1 | (held & 0x01000000) << 1 | 0x500
        if offset == self.CFGR:
            return held & ~0xC | (held & 3) << 2
        if offset == self.CSR:
            return held | self.cause | (held & 1) << 1
        if offset == self.CRRCR:
            return held | (held & 1) << 1
        return held

    def write(self, offset, value):
        if offset == self.CSR and value & self.CLEAR:
            self.cause = 0
            value &= ~self.CLEAR
        self.held[offset] = value & 0xFFFFFF if offset == self.CSR else value


class Flash(Peripheral):
    """The flash interface: double words with ECC, pages, two banks; its power can be cut at any operation."""

    KEYR, SR, CR, ECCR, OPTR = 0x08, 0x10, 0x14, 0x18, 0x20
    PROGRAM, ERASE, START, LOCK, BUSY, DONE = 1, 2, 1 << 16, 1 << 31, 1 << 16, 1
    KEY = 0xCDEF89AB
    DETECTED = 1 << 31

    def __init__(self, core, base):
        super().__init__(core, base)
        self.operations, self.cut_at, self.first_half, self.broken = 0, None, None, set()
        self.busy_until, self.faults, self.ecc_unit = 0.0, [], 1
        self.erase_ns = ERASE_NS
        core.on_flash_write(self.on_write)
        core.uc.hook_add(UC_HOOK_MEM_READ, self.on_read, begin=STORAGE[0], end=sum(STORAGE) - 1)

    def reset(self):
        super().reset()
        self.held.update({self.OPTR: 0xFFEFF8AA, self.CR: 0xC0000000})

    def read(self, offset):
        is_busy = offset == self.SR and self.core.ns < self.busy_until
        if is_busy:
            self.core.stall(POLL_NS)
        return self.get(offset) | (self.BUSY if is_busy else 0)

    def write(self, offset, value):
        if offset == self.KEYR:
            if value == self.KEY:
                self.held[self.CR] &= ~self.LOCK
        elif offset in (self.SR, self.ECCR):  # flags are cleared by ones
            self.held[offset] = self.get(offset) & ~value
        elif offset == self.CR:
            self.control(value)
        else:
            self.held[offset] = value

    def control(self, value):
        if self.get(self.CR) & self.LOCK:
            return
        self.held[self.CR] = value & ~self.START
        if value & self.START and value & self.ERASE:
            self.erase(FLASH + (value >> 3 & 0x7F) * PAGE + (value >> 11 & 1) * BANK)

    def erase(self, page):
        part = self.perform(PAGE)
        self.wipe(page, part)
        self.broken -= set(range(page, page + part, 8))
        self.end()
        self.busy_until = self.core.ns + self.erase_ns

    def wipe(self, start, size):
        self.core.uc.mem_write(start, b"\xff" * size)

    def on_write(self, uc, access, address, size, value, data):
        """A word of a double word; the second one programs both."""
        if not self.get(self.CR) & self.PROGRAM or size != 4:
            self.faults.append(f"a write of {size} bytes at {address:#x} that is no programming")
            return
        if bytes(uc.mem_read(address, 4)) != b"\xff" * 4:
            self.faults.append(f"the word at {address:#x} is not erased")
        if address % 8 == 0:
            self.first_half = address
        elif self.first_half == address - 4:
            self.program(address - 4, uc)

    def program(self, address, uc):
        part = self.perform(8)
        if part < 8:
            # The words are in memory before this hook ends: what the cut leaves is made here, and again by `settle`.
            self.unfinished = address, part
        self.end()

    def perform(self, size):
        cut = self.cut_at is not None and self.operations == self.cut_at[0]
        self.operations += 1
        self.is_cut = cut
        return int(size * self.cut_at[1]) if cut else size

    def end(self):
        self.held[self.SR] = self.get(self.SR) | self.DONE
        if self.is_cut:
            self.core.stop("power cut")

    def settle(self):
        """After a cut: a double word of which a part was programmed reads as that part, and with an error that ECC cannot correct."""
        if (unfinished := getattr(self, "unfinished", None)) is None:
            return
        address, part = unfinished
        whole = bytes(self.core.uc.mem_read(address, 8))
        self.core.uc.mem_write(address, whole[:part] + b"\xff" * (8 - part))
        if part:
            self.broken.add(address)

    def on_read(self, uc, access, address, size, value, data):
        # For a hook, unicorn puts the state of an IT block back to where the load is, and goes on with that behind the block. The load is carried out, so its condition
        # holds; the rest of a block has the same one in what is compiled here.
        if (psr := uc.reg_read(UC_ARM_REG_XPSR)) & IT_STATE:
            uc.reg_write(UC_ARM_REG_XPSR, psr & ~IT_STATE)
        word = address & ~7
        if word in self.broken and not self.core.is_finishing and not self.get(self.ECCR) & self.DETECTED:
            self.detect(word)
            self.core.stop("NMI")

    def detect(self, word):
        """Two wrong bits. Whether ADDR_ECC counts bytes or double words is not known here, so both are tried (`ecc_unit`)."""
        bank = word >= FLASH + BANK
        self.held[self.ECCR] = self.DETECTED | bank << 21 | (word - FLASH - bank * BANK) // self.ecc_unit
        self.core.nmis += 1


class G474(Board):
    """A node on a Nucleo-G474RE."""

    image, boot_ms, storage_at, baud = "nucleo_g474re", BOOT_MS, STORAGE, BAUD

    def __init__(self, image=None, serial=1, storage=None, broken=()):
        core = Core(self.path(image), HZ, FLASH, FLASH_SIZE, 128 << 10, [INFORMATION])
        core.uc.mem_write(UID, bytes(range(1, 12)) + bytes([serial]))
        self.rcc = core.add(Rcc(core, 0x40021000))
        self.flash = core.add(Flash(core, 0x40022000))
        self.timer = core.add(Timer(core, 0x40000000, HZ))
        self.watchdog = core.add(Iwdg(core, 0x40003000))
        self.can = core.add(Fdcan(core, 0x40006400, 0x4000A400))
        self.flash.broken |= set(broken)
        super().__init__(core, core.add(Lpuart(core, 0x40008000, 91, self.baud)), self.baud, storage)


class G474Fd(G474):
    """The same with frames of CAN FD."""

    image, format = "nucleo_g474re_can_fd", "fd"


class G474Peers(G474):
    """A node with lines to neighbours instead: USART 1, USART 3, UART 4, UART 5, whose registers are those of the LPUART."""

    image, baud = "nucleo_g474re_peers", 1_000_000

    def __init__(self, image=None, serial=1, storage=None, broken=()):
        super().__init__(image, serial, storage, broken)
        for base, irq in ((0x40013800, 37), (0x40004800, 39), (0x40004C00, 52), (0x40005000, 53)):
            self.add_line(self.core.add(Lpuart(self.core, base, irq, self.baud)), self.baud)


class G474Check(Check, G474):
    """The image that checks its board: a wire from the TX of USART 1 to its RX, and alarms by TIM 2."""

    image, alarms = "board_check_g474", Timer.IRQ

    def __init__(self, storage=None, **options):
        super().__init__(storage=storage)
        self.pins = self.core.add(Gpio(self.core, 0x48000000))
        self.connect(self.core.add(Lpuart(self.core, 0x40013800, 37, self.echo_baud)), **options)

    def take_number(self):
        self.core.uc.mem_write(UID, bytes(12))
