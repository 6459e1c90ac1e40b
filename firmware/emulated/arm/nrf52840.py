"""The nRF52840-DK."""

import struct

from board import Board
from core import Core
from nrf_peripherals import Clock, Counter, Microseconds, Nvmc, Ppi, Rtc, Uarte, Wdt

FLASH, FLASH_SIZE = 0x00000000, 1 << 20
STORAGE = 0x000FC000, 16 << 10
# FICR with UICR, and the registers of an erratum.
INFORMATION = (0x10000000, 0x2000), (0xF0000000, 0x1000)
HZ, BAUD = 64_000_000, 1_000_000
BOOT_MS = 10


class NrfCore(Core):
    """A core whose tasks can be started by the PPI."""

    def run_task(self, address):
        peripheral = self.by_page[address & ~0x3FF]
        peripheral.task(address - peripheral.base)


class Nrf52840(Board):
    """A node on an nRF52840-DK."""

    image, boot_ms, storage_at = "nrf52840_dk", BOOT_MS, STORAGE

    def __init__(self, image=None, serial=1, storage=None, broken=()):
        core = NrfCore(self.path(image), HZ, FLASH, FLASH_SIZE, 256 << 10, INFORMATION)
        core.uc.mem_write(0x10000000, b"\xff" * 0x2000)
        for address, *values in ((0x10000060, 0x11220000 + serial, 0x33445566), (0x10000130, 8), (0x10000100, 0x52840, 0x41414630)):
            core.uc.mem_write(address, struct.pack(f"<{len(values)}I", *values))
        core.ppi = core.add(Ppi(core, 0x4001F000))
        self.rcc = core.add(Clock(core, 0x40000000))
        self.counter = core.add(Counter(core, 0x40008000))
        core.add(Microseconds(core, 0x4000A000))
        self.rtc = core.add(Rtc(core, 0x40011000))
        self.watchdog = core.add(Wdt(core, 0x40010000))
        self.flash = core.add(Nvmc(core, 0x4001E000))
        super().__init__(core, core.add(Uarte(core, 0x40002000, 2, BAUD)), BAUD, storage)


class Nrf52840Peers(Nrf52840):
    """A node with a line to a neighbour, too: UARTE 1, with the counter and the channels that its driver wants."""

    image = "nrf52840_dk_peers"

    def __init__(self, image=None, serial=1, storage=None, broken=()):
        super().__init__(image, serial, storage, broken)
        self.core.add(Counter(self.core, 0x40009000))
        self.add_line(self.core.add(Uarte(self.core, 0x40028000, 40, BAUD)), BAUD)
