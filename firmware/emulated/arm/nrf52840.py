"""The nRF52840-DK."""

import struct

from board import Board
from check import Check
from core import Core
from nrf_peripherals import Clock, Counter, Gpio, Microseconds, Nvmc, Ppi, Rtc, Uarte, Wdt
from stm32 import LineIn

FLASH, FLASH_SIZE = 0x00000000, 1 << 20
STORAGE = 0x000FC000, 16 << 10
# FICR with UICR, and the registers of an erratum.
INFORMATION = (0x10000000, 0x2000), (0xF0000000, 0x1000)
DEVICE_ID = 0x10000060
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
        for address, *values in ((DEVICE_ID, 0x11220000 + serial, 0x33445566), (0x10000130, 8), (0x10000100, 0x52840, 0x41414630)):
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


class Nrf52840Check(Check, Nrf52840):
    """The image that checks its board: a wire from the TX of UARTE 1 to its RX, and alarms by RTC 1. A word takes what the product specification has at most."""

    image, alarms = "board_check_nrf52840", Rtc.IRQ

    def __init__(self, storage=None, **options):
        super().__init__(storage=storage)
        self.flash.program_ns = 41e3
        self.pins = self.core.add(Gpio(self.core, 0x50000000))
        self.core.add(Counter(self.core, 0x40009000))
        self.connect(self.core.add(Uarte(self.core, 0x40028000, 40, self.echo_baud)), **options)
        # What it sends leaves all at once here, and would come so.
        self.back = LineIn(self.core, self.echo, self.echo_baud)
        self.peers.append((self.echo, self.back))

    def comes_back(self, byte):
        if self.wire:
            self.back.push([self.wire(byte)])

    def take_number(self):
        self.core.uc.mem_write(DEVICE_ID, b"\xff" * 8)
