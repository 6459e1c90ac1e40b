"""The image that checks its own Nucleo-G474RE: all is well with all of its hardware there, and each check says what is missing where it is taken
away."""

import random
import re
import unittest

from g474 import ERASE_NS, G474, PAGE, STORAGE, UID, G474Check
from words import CONFIGURED, STORED, Words

CHECKS = ("unique number", "clock", "ticks", "serial echo", "CAN loop-back", "program", "erase", "stored configuration", "watchdog")
LONGEST_MS, TICKS = 60_000, 1000


def run(board):
    """Until its report ends."""
    end = board.core.ns + LONGEST_MS * 1e6
    while not re.search(r"DONE.*\n", board.text) and board.core.ns < end:
        board.ms(5)
    return board


def until(board, text):
    """Until it has said this."""
    end = board.core.ns + LONGEST_MS * 1e6
    while text not in board.text and board.core.ns < end:
        board.ms(5)


def rows(board):
    """Cells of each row by its check: verdict, what was measured, limit."""
    lines = [line for line in board.text.split("\r\n") if line.startswith(f"| {board.image}")]
    return {cells[1]: cells[2:] for cells in ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)}


def stored():
    """The storage of a node with a configuration."""
    board = G474.booted()
    board.ask(Words.of()["nodes"][0]["configure"], CONFIGURED)
    assert "ok" in board.ask(Words.of()["store"], STORED)["stored"]
    return board.storage()


def erase_nothing(flash):
    """Erases take their time, and all stays."""
    def erase(page):
        flash.is_cut = False
        flash.end()
        flash.busy_until = flash.core.ns + ERASE_NS
    flash.erase = erase


def program_nothing(flash):
    """Writes take effect on no cell: they are undone as soon as the driver looks whether they are done."""
    written, look = set(), flash.read

    def read(offset):
        for address in written:
            flash.core.uc.mem_write(address, b"\xff" * 4)
        written.clear()
        return look(offset)

    flash.read = read
    flash.core.on_flash_write(lambda uc, access, address, size, value, data: written.add(address))


def erase_all(flash):
    """An erase takes all of the storage with it, and too long."""
    def erase(page):
        flash.core.uc.mem_write(STORAGE[0], b"\xff" * STORAGE[1])
        flash.is_cut = False
        flash.end()
        flash.busy_until = flash.core.ns + 3 * ERASE_NS
    flash.erase = erase


def jitter(timer, most_ns):
    """Interrupts of the timer come late, by a time that is drawn."""
    draw, raise_line, advance, following = random.Random(1), timer.raise_line, timer.advance, timer.next_event
    due = []

    def late():
        if not timer.get(timer.SR) & timer.get(timer.DIER) & 0x1F:
            due.clear()
            raise_line()
        elif not due:
            due.append(timer.core.ns + draw.random() * most_ns)

    def go_on(before, after):
        advance(before, after)
        if due and after >= due[0]:
            raise_line()

    timer.raise_line, timer.advance = late, go_on
    timer.next_event = lambda: min([at for at in (following(), *due) if at is not None], default=None)


class Check(unittest.TestCase):
    """What it says."""

    def verdicts(self, board, **others):
        """All pass but these, whose names are with underscores."""
        found = rows(board)
        self.assertEqual(tuple(found), CHECKS, board.text)
        wanted = {check: others.get(re.sub(r"\W", "_", check), "PASS") for check in CHECKS}
        self.assertEqual({check: cells[0] for check, cells in found.items()}, wanted, board.text)
        return found

    def test_with_all_of_its_hardware_every_check_passes_and_the_stored_configuration_stays(self):
        storage = stored()
        board = run(G474Check(storage))
        print(board.text)
        found = self.verdicts(board)
        self.assertRegex(board.text, r"DONE: 9 PASS, 0 FAIL, 0 SKIPPED\r\n$")
        self.assertLess(board.core.ns, LONGEST_MS * 1e6)
        self.assertRegex(found["stored configuration"][1], "^node 1, checksum 0x[0-9a-f]{8}$")
        self.assertEqual((board.core.resets, board.can.sent, board.flash.faults), (1, [], []))
        self.assertGreaterEqual(board.pins.changes, TICKS - 1)
        after = board.storage()
        changed = [at for at in range(0, len(storage), PAGE) if storage[at:at + PAGE] != after[at:at + PAGE]]
        self.assertLessEqual(len(changed), 1)
        node, identity = Words.of()["nodes"][0], G474.booted(storage=after).identity(Words.of())
        self.assertEqual((identity["id"], identity["checksum"]), (node["id"], node["checksum"]))
        # It is done: nothing more is said, and it is not reset any more.
        text = board.text
        board.ms(5000)
        self.assertEqual((board.text, board.core.resets), (text, 1))

    def test_no_jumper_can_that_hears_nothing_flash_that_keeps_nothing_and_no_watchdog_are_each_found(self):
        board = G474Check(wire=None)
        board.can.loops_back = False
        program_nothing(board.flash)
        board.watchdog.advance, board.watchdog.next_event = lambda before, after: None, lambda: None
        found = self.verdicts(run(board), serial_echo="SKIPPED", CAN_loop_back="FAIL", program="FAIL", watchdog="FAIL")
        self.assertIn("no jumper from PC4 to PC5", found["serial echo"][1])
        self.assertEqual(found["CAN loop-back"][1], "0 frames came back")
        self.assertRegex(found["program"][1], " bytes wrong$")
        self.assertRegex(found["watchdog"][1], "^no reset within")

    def test_a_bad_wire_ticks_that_jitter_flash_that_is_not_erased_and_another_reset_are_each_found(self):
        sent = iter(range(1, 10_000))
        board = G474Check(wire=lambda byte: byte ^ 4 if next(sent) % 50 == 0 else byte)
        jitter(board.timer, 100e3)
        erase_nothing(board.flash)
        until(board, "stored configuration")
        board.ms(500)
        board.core.reset("reset request")
        found = self.verdicts(run(board), ticks="FAIL", serial_echo="FAIL", erase="FAIL", watchdog="FAIL")
        self.assertEqual(found["serial echo"][1], "256 bytes, 5 wrong")
        self.assertRegex(found["erase"][1], " bytes not erased$")
        self.assertRegex(found["watchdog"][1], r"^reset by software after [45]\d\d,\d{3} us$")

    def test_an_erase_that_is_slow_and_takes_the_configuration_with_it_and_a_missing_crystal_and_number_are_found(self):
        board = G474Check(stored())
        erase_all(board.flash)
        board.rcc.has_crystal, board.timer.hz = False, 16_000_000
        board.core.uc.mem_write(UID, bytes(12))
        found = self.verdicts(run(board), unique_number="FAIL", clock="FAIL", erase="FAIL", stored_configuration="FAIL")
        self.assertIn("no crystal", found["clock"][1])

    def test_a_reset_in_the_middle_of_a_check_ends_the_report(self):
        board = G474Check()
        until(board, "| clock")
        board.ms(500)
        board.core.hang()
        run(board)
        self.assertRegex(board.text, r"\| ticks \| FAIL \| reset in it: the watchdog \| no reset \|\r\nDONE: 2 PASS, 1 FAIL, 0 SKIPPED\r\n$")


if __name__ == "__main__":
    unittest.main()
