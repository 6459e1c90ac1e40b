"""An image that checks its board: what all of them have, and how hardware is taken away from them."""

import random
import re

from core import Peripheral

LONGEST_MS = 60_000


class Check:
    """Mixed into the class of a board: a wire from the TX of its line for the echo to its RX, which may not be there or change bytes."""

    echo_baud = 1_000_000
    # The interrupt of its alarms.
    alarms = None

    def connect(self, echo, wire=lambda byte: byte):
        self.echo, self.wire = echo, wire
        echo.on_byte = self.comes_back

    def comes_back(self, byte):
        """A byte has left, and arrives by the wire."""
        if self.wire:
            self.echo.feed(self.wire(byte))
            if not self.echo.going:
                self.echo.pause()

    @property
    def text(self):
        """What it has said."""
        return bytes(self.uart.said).decode("ascii", "replace")

    def until(self, wanted):
        """Until it has said this."""
        end = self.core.ns + LONGEST_MS * 1e6
        while not re.search(wanted, self.text) and self.core.ns < end:
            self.ms(5)
        return self

    def finished(self):
        """At the end of its report."""
        return self.until(r"DONE.*\n")

    @property
    def rows(self):
        """Cells of each row by its check: verdict, what was measured, limit."""
        lines = [line for line in self.text.split("\r\n") if line.startswith(f"| {self.image}")]
        return {cells[1]: cells[2:] for cells in ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)}


def erase_nothing(board):
    """Erases take their time, and all stays."""
    board.flash.wipe = lambda start, size: None


def program_nothing(board):
    """Writes take effect on no cell: they are undone as soon as the driver looks whether they are done."""
    written, look, uc = {}, board.flash.read, board.core.uc

    def read(offset):
        for address, size in written.items():
            uc.mem_write(address, b"\xff" * size)
        written.clear()
        return look(offset)

    board.flash.read = read
    board.core.on_flash_write(lambda uc, access, address, size, value, data: written.update({address: size}))


def erase_all(board):
    """An erase takes all of the storage with it, and too long."""
    start, size = board.storage_at
    board.flash.wipe = lambda *_: board.core.uc.mem_write(start, b"\xff" * size)
    board.flash.erase_ns *= 3


def no_watchdog(board):
    """It counts, and nothing happens."""
    board.watchdog.advance, board.watchdog.next_event = lambda before, after: None, lambda: None


class Late(Peripheral):
    """An interrupt that comes late, by a time that is drawn, ns at most."""

    def __init__(self, core, number, most_ns):
        super().__init__(core, 0x4FFF0000)
        self.number, self.most_ns, self.draw, self.due, self.irq = number, most_ns, random.Random(1), None, core.irq
        core.irq = self.on_irq

    def on_irq(self, number, is_up):
        if number != self.number or not is_up:
            self.due = None if number == self.number else self.due
            self.irq(number, is_up)
        elif number not in self.core.levels and self.due is None:
            self.due = self.core.ns + self.draw.random() * self.most_ns

    def advance(self, before, after):
        if self.due is not None and after >= self.due:
            self.due = None
            self.irq(self.number, True)

    def next_event(self):
        return self.due


def jitter(board, most_ns):
    """Its alarms come late, by up to so much."""
    board.core.add(Late(board.core, board.alarms, most_ns))
