"""Three heaters on Nucleo-G474REs with a simulated block each, on one CAN bus: they agree on a temperature within their funnel, by what the nodes have counted and by what
the blocks are. With a fault in one of them, or without the law, the same must not pass."""

import unittest

from bus import Bus
import settings
from heater import Heater, stuck, unwired
from words import CONFIGURED, REPORT, words

SCENARIO, NODES, BROKEN = "firmware/heaters.toml", 3, 1
LONG = "half a minute: FUNNEL_EXTENDED=1"
# All of the scenario takes minutes; a funnel that closes faster has closed as far by then.
SHORTER = () if settings.EXTENDED else ("coupling.funnel.rate=0.03", "time.duration=200s")
# Largest difference of two blocks at the end, K.
SPREAD = 1.5
# What a tick of 100 ms takes here, beside its frames: by SYNC, as on a bench in lockstep.
TICK_NS = 200e3
# A frame of 5 bytes on a bus of 1 Mbit/s.
FRAME_NS = 90e3
# Conversions beside one for each tick: for the state that is announced before the first.
ANNOUNCED = 1


def configured(said, index=0, **options):
    """A heater with its configuration."""
    board = Heater.booted(**options)
    assert board.ask(said["nodes"][index]["configure"], CONFIGURED)["configured"] == {"ok": None}
    return board


class Wire(Bus):
    """A bus on which one frame comes after the other: all at one moment are more than a controller has room for."""

    def put(self, frame, sender=None):
        super().put(frame, sender)
        for board in self.boards:
            board.run(FRAME_NS)


class Heaters(unittest.TestCase):
    """A network of them."""

    def run_all(self, *overrides, spoil=lambda board: None):
        """Runs them; what is wrong with the run, as a text."""
        said = words(SCENARIO, *SHORTER, *overrides)
        # As firmware/src/bin/heater_emulated.rs deals the blocks: by the remainder of the node's id.
        boards = [configured(said, index, serial=index + 1, which=(index + 1) % NODES) for index in range(NODES)]
        spoil(boards[BROKEN])
        bus, ticks = Wire(boards), len(said["ticks"]) - 1
        bus.start(said)
        for tick in range(ticks):
            bus.put(boards[0].frame(said["ticks"][tick]["sync"]))
            bus.run(TICK_NS)
        reports = [board.ask(said["report"], REPORT)["report"] for board in boards]
        bus.put(boards[0].frame(said["stop"]))
        bus.run(1e6)
        return self.complaints(boards, reports, ticks)

    def complaints(self, boards, reports, ticks):
        celsius, most = [board.block.celsius for board in boards], max(report["max_ratio"] for report in reports)
        spread = max(celsius) - min(celsius)
        print(f"{ticks} ticks of three heaters: {', '.join(f'{each:.2f}' for each in celsius)} degrees C, |nu|/psi at most {most:.2f}")
        counters = {name: [report["counters"][name] for report in reports] for name in ("breaches", "coasted", "overruns", "late", "extrapolated")}
        found = [
            (not most < 1, f"a funnel was left: {most:.2f}"),
            (any(map(any, counters.values())), f"counters {counters}"),
            ([report["counters"]["ticks"] for report in reports] != [ticks] * NODES, "not every tick"),
            ([board.block.conversions for board in boards] != [ticks + ANNOUNCED] * NODES, "not one conversion for each tick"),
            (not spread < SPREAD, f"the blocks are {spread:.2f} K apart"),
            (any(board.adc.faults for board in boards), f"a converter: {boards[0].adc.faults}"),
            (any(board.can.lost for board in boards), "lost frames"),
            (any(board.duty for board in boards), "a heater is on after the stop"),
        ]
        return "; ".join(text for is_so, text in found if is_so)

    def test_they_agree_within_their_funnel(self):
        self.assertEqual(self.run_all(), "")

    def test_a_converter_that_is_stuck_is_seen_in_the_blocks(self):
        self.assertIn("K apart", self.run_all(spoil=stuck))

    @unittest.skipUnless(settings.EXTENDED, LONG)
    def test_a_heater_whose_wire_is_off_leaves_the_funnel(self):
        self.assertIn("a funnel was left", self.run_all(spoil=unwired))

    @unittest.skipUnless(settings.EXTENDED, LONG)
    def test_without_the_law_they_stay_apart(self):
        self.assertIn("K apart", self.run_all("coupling.kind=none"))


class Output(unittest.TestCase):
    """What the heater's pin does."""

    @classmethod
    def setUpClass(cls):
        cls.said = words(SCENARIO, "time.duration=1s")

    def heating(self):
        board = configured(self.said)
        self.assertEqual(board.duty, 0)
        for word in (self.said["start"], self.said["ticks"][0]["sync"]):
            board.can.receive(board.frame(word))
            board.ms(2)
        self.assertGreater(board.duty, 0.05, "it does not heat: the test shows nothing")
        return board

    def before_reset(self, board):
        """What its output is at each reset, before it."""
        duties, reset = [], board.core.reset
        board.core.reset = lambda cause: (duties.append(board.duty), reset(cause))
        return duties

    def test_a_stop_makes_the_output_safe(self):
        board = self.heating()
        board.can.receive(board.frame(self.said["stop"]))
        board.ms(2)
        self.assertEqual(board.duty, 0)

    def test_a_hard_fault_makes_the_output_safe_before_the_reset_and_it_stays_so_after_it(self):
        board = self.heating()
        duties = self.before_reset(board)
        board.core.fault()
        board.ms(50)
        self.assertEqual((duties, board.duty), ([0], 0))
        self.assertEqual(board.identity(self.said)["reset"], "HardFault")

    def test_a_program_that_hangs_keeps_its_output_until_its_watchdog_resets_it(self):
        board = self.heating()
        wanted, duties, begin = board.duty, self.before_reset(board), board.core.ns
        board.core.hang()
        while not duties and board.core.ns < begin + 3e9:
            board.ms(10)
        self.assertEqual(duties, [wanted], "docs/book/src/safety.md, \"What is not covered\"")
        self.assertLess(board.core.ns - begin, 2.05e9)
        board.ms(50)
        self.assertEqual(board.duty, 0)


if __name__ == "__main__":
    unittest.main()
