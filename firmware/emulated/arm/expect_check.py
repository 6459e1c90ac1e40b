"""What the tests of all images that check their board expect. Mixed into a `unittest.TestCase` with NODE and CHECK, the classes of the board with its node's image and with
this one; PAGE, bytes that are erased together; JUMPER, where the wire goes; and CAN, what it says of it."""

import re

from check import LONGEST_MS, erase_all, erase_nothing, jitter, no_watchdog, program_nothing
from words import CONFIGURED, STORED, Words

CHECKS = ("unique number", "clock", "ticks", "serial echo", "CAN loop-back", "program", "erase", "stored configuration", "watchdog")
TICKS = 1000
# How finely a driver that waits sees the end of an erase in a model: far finer than the turn of a timer that a clock could miss meanwhile.
ERASE_ERROR_US = 10e3


class Checks:
    """What it says, with all of its hardware and without some of it."""

    CAN = "PASS"
    # How late alarms have to come, at most, to be found: more than what the clock waits for awake.
    JITTER_NS = 100e3

    def verdicts(self, board, **others):
        """All pass but these, whose names are with underscores."""
        found = board.rows
        self.assertEqual(tuple(found), CHECKS, board.text)
        others = {"CAN_loop_back": self.CAN, **others}
        wanted = {check: others.get(re.sub(r"\W", "_", check), "PASS") for check in CHECKS}
        self.assertEqual({check: cells[0] for check, cells in found.items()}, wanted, board.text)
        return found

    def stored(self):
        """The storage of a node with a configuration."""
        board = self.NODE.booted()
        board.ask(Words.of()["nodes"][0]["configure"], CONFIGURED)
        self.assertIn("ok", board.ask(Words.of()["store"], STORED)["stored"])
        return board.storage()

    def changed(self, board, storage):
        """Pages of its storage that are not what they were."""
        after, size = board.storage(), self.PAGE
        return [at for at in range(0, len(storage), size) if storage[at:at + size] != after[at:at + size]]

    def test_with_all_of_its_hardware_every_check_passes_and_the_stored_configuration_stays(self):
        storage = self.stored()
        board = self.CHECK.booted(storage).finished()
        print(board.text)
        found = self.verdicts(board)
        passed = sum(cells[0] == "PASS" for cells in found.values())
        self.assertRegex(board.text, rf"DONE: {passed} PASS, 0 FAIL, {len(CHECKS) - passed} SKIPPED\r\n$")
        self.assertLess(board.core.ns, LONGEST_MS * 1e6)
        self.assertRegex(found["stored configuration"][1], "^node 1, checksum 0x[0-9a-f]{8}$")
        erase_us = int(found["erase"][1].removesuffix(" us").replace(",", ""))
        self.assertAlmostEqual(erase_us, board.flash.erase_ns / 1e3, delta=ERASE_ERROR_US)
        self.assertEqual((board.core.resets, board.flash.faults), (1, []))
        self.assertGreaterEqual(board.pins.changes, TICKS - 1)
        self.assertLessEqual(len(self.changed(board, storage)), 1)
        node, identity = Words.of()["nodes"][0], self.NODE.booted(storage=board.storage()).identity(Words.of())
        self.assertEqual((identity["id"], identity["checksum"]), (node["id"], node["checksum"]))
        # It is done: nothing more is said, and it is not reset any more.
        text = board.text
        board.ms(5000)
        self.assertEqual((board.text, board.core.resets), (text, 1))

    def test_no_jumper_flash_that_keeps_nothing_and_no_watchdog_are_each_found(self):
        board = self.CHECK(wire=None)
        program_nothing(board)
        no_watchdog(board)
        found = self.verdicts(board.finished(), serial_echo="SKIPPED", program="FAIL", watchdog="FAIL")
        self.assertIn(f"no jumper {self.JUMPER}", found["serial echo"][1])
        self.assertRegex(found["program"][1], " bytes wrong$")
        self.assertRegex(found["watchdog"][1], "^no reset within")

    def test_a_bad_wire_ticks_that_jitter_flash_that_is_not_erased_and_another_reset_are_each_found(self):
        sent = iter(range(1, 10_000))
        board = self.CHECK(wire=lambda byte: byte ^ 4 if next(sent) % 50 == 0 else byte)
        jitter(board, self.JITTER_NS)
        erase_nothing(board)
        board.until("stored configuration").ms(500)
        board.core.reset("reset request")
        found = self.verdicts(board.finished(), ticks="FAIL", serial_echo="FAIL", erase="FAIL", watchdog="FAIL")
        self.assertEqual(found["serial echo"][1], "256 bytes, 5 wrong")
        self.assertRegex(found["erase"][1], " bytes not erased$")
        self.assertRegex(found["watchdog"][1], r"^reset by software after [45]\d\d,\d{3} us$")

    def test_an_erase_that_is_slow_and_takes_the_configuration_with_it_and_a_missing_number_are_found(self):
        board = self.CHECK(self.stored())
        erase_all(board)
        board.take_number()
        self.verdicts(board.finished(), unique_number="FAIL", erase="FAIL", stored_configuration="FAIL")

    def test_a_reset_in_the_middle_of_a_check_ends_the_report(self):
        board = self.CHECK().until(r"\| clock.*\n")
        board.ms(500)
        board.core.hang()
        board.finished()
        self.assertRegex(board.text, r"\| ticks \| FAIL \| reset in it: the watchdog \| no reset \|\r\nDONE: 2 PASS, 1 FAIL, 0 SKIPPED\r\n$")


class OnCan:
    """And a controller that can be looped back."""

    def test_can_that_hears_nothing_is_found_and_nothing_of_it_is_on_the_bus(self):
        board = self.CHECK()
        board.can.loops_back = False
        found = self.verdicts(board.finished(), CAN_loop_back="FAIL")
        self.assertEqual((found["CAN loop-back"][1], board.can.sent), ("0 frames came back", []))
        board = self.CHECK().until("CAN loop-back.*\n")
        self.assertEqual((board.rows["CAN loop-back"][0], board.can.sent), ("PASS", []))


class OneClock:
    """And one clock of the board, without which it goes on by its own oscillator."""

    # Of the timer behind its clock then.
    TIMER_HZ_WITHOUT = None

    def test_a_missing_clock_is_found(self):
        board = self.CHECK()
        board.rcc.has_crystal = False
        board.timer.hz = self.TIMER_HZ_WITHOUT or board.timer.hz
        found = self.verdicts(board.finished(), clock="FAIL")
        self.assertIn(self.NO_CLOCK, found["clock"][1])
