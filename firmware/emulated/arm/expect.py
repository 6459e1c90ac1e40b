"""What the tests of several boards expect alike. Mixed into a `unittest.TestCase` with BOARD, the class of the board."""

import random

from board import kind
from bus import Bus, frame
from core import PowerCut
from fdcan import Frame
import settings
from words import CONFIGURED, REPORT, STAGED, STATE, STORED, read, words

SCENARIO = "firmware/emulated/pair.toml"
DEPTHS = (0, 0.5, 1)
TICK_US, LARGEST_JITTER = 1000, 0.05
# Function codes of states on CAN.
STATES = 3, 10


class Words:
    """Read once."""

    known = {}

    @classmethod
    def of(cls, *overrides):
        if overrides not in cls.known:
            cls.known[overrides] = words(SCENARIO, *overrides)
        return cls.known[overrides]


class Commissioned:
    """A node that stores, whatever its bus."""

    def configured(self, board, index=0):
        answer = board.ask(Words.of()["nodes"][index]["configure"], CONFIGURED)
        self.assertEqual(answer["configured"], {"ok": None})
        return board

    def stored(self):
        board = self.configured(self.BOARD.booted())
        self.assertIn("ok", board.ask(Words.of()["store"], STORED)["stored"])
        return board

    def test_it_says_who_it_is(self):
        identity = self.BOARD.booted().identity(Words.of())
        self.assertEqual((identity["id"], identity["reset"], identity["starts"]), (0, "PowerOn", 1))
        self.assertNotEqual(identity["uid"], 0)
        self.assertNotEqual(identity["uid"], self.BOARD.booted(serial=2).identity(Words.of())["uid"])

    def test_its_configuration_survives_a_power_cycle(self):
        board = self.stored()
        self.assertEqual(board.flash.faults, [])
        node, after = Words.of()["nodes"][0], self.BOARD.booted(storage=board.storage()).identity(Words.of())
        self.assertEqual((after["id"], after["checksum"]), (node["id"], node["checksum"]))
        # The other world: one that was configured and not stored is blank.
        board = self.configured(self.BOARD.booted())
        self.assertEqual(self.BOARD.booted(storage=board.storage()).identity(Words.of())["id"], 0)

    def test_a_program_that_hangs_is_reset_by_its_watchdog(self):
        board = self.BOARD.booted()
        begin = board.core.ns
        board.core.hang()
        while not board.core.resets and board.core.ns < begin + 3e9:
            board.ms(10)
        self.assertAlmostEqual((board.core.ns - begin) / 1e9, self.WATCHDOG_S, delta=0.55)
        board.ms(self.BOARD.boot_ms)
        identity = board.identity(Words.of())
        self.assertEqual((identity["reset"], identity["starts"]), ("Watchdog", 2))

    def test_a_node_that_idles_is_never_reset(self):
        board = self.BOARD.booted()
        board.ms(5000)
        self.assertEqual(board.core.resets, 0)
        self.assertLess(board.watchdog.longest, 0.6e9)

    def test_a_hard_fault_resets_it_and_it_says_so(self):
        board = self.BOARD.booted()
        board.core.fault()
        board.ms(self.BOARD.boot_ms + 10)
        self.assertEqual(board.core.resets, 1)
        identity = board.identity(Words.of())
        self.assertEqual((identity["reset"], identity["starts"]), ("HardFault", 2))

    def commission(self, storage, cut_at=None):
        """Stages another configuration and commits it, until the cut: operation and depth."""
        board = self.BOARD.booted(storage=storage)
        board.flash.operations, board.flash.cut_at = 0, cut_at
        try:
            board.ask(Words.of()["nodes"][0]["stage_other"], STAGED)
            board.tell(Words.of()["commit"]["serial"])
            board.ms(100)
        except PowerCut:
            board.flash.settle()
        return board

    def after(self, board):
        """What a board is after a power cycle: a checksum."""
        identity = self.BOARD.booted(storage=board.storage(), broken=board.flash.broken).identity(Words.of())
        return identity["checksum"] if identity and identity["id"] == 1 else "blank or silent"

    def test_a_power_cut_leaves_the_old_configuration_or_the_new_one(self):
        node, storage = Words.of()["nodes"][0], self.stored().storage()
        old, new = node["checksum"], node["other_checksum"]
        whole = self.commission(storage)
        self.assertEqual(self.after(whole), new)
        last = whole.flash.operations - 1
        cuts = [(operation, depth) for operation in [*range(0, last, self.CUT_EVERY), last] for depth in DEPTHS]
        ends = [self.after(self.commission(storage, cut)) for cut in cuts]
        print(f"{self.BOARD.image}: {len(ends)} cuts at {last + 1} flash operations: {ends.count(old)} keep the old configuration, "
              f"{ends.count(new)} have the new one")
        self.assertEqual(set(ends) - {old, new}, set(), list(zip(cuts, ends)))
        self.assertEqual(ends[-1], new)
        self.assertEqual(ends[0], old)


class OnLine(Commissioned):
    """A node with both planes on one serial line; the test is the hub, and its neighbour."""

    def test_it_runs_the_bits_of_loopback(self):
        board = self.configured(self.BOARD.booted())
        ticks = Words.of()["ticks"]
        begin = len(board.frames())
        board.tell(Words.of()["start"]["serial"])
        board.ms(1)
        for tick in ticks[:-1]:
            board.tell(tick["states"][1][0]["serial"])
            board.tell(tick["sync"]["serial"])
            board.ms(1)
        said = [bytes(frame).hex() + "00" for frame in board.frames()[begin:] if kind(frame) == STATE]
        self.assertEqual(said, [tick["states"][0][0]["serial"] for tick in ticks])
        self.assertEqual(board.uart.overruns, 0)

    def test_noise_leaves_a_node_that_answers(self):
        board, draw = self.configured(self.BOARD.booted()), random.Random(1)
        for byte in draw.randbytes(settings.noise_bytes()):
            board.uart.feed(byte)
            board.run(board.line.byte_ns)
        board.tell("00")
        self.assertEqual(board.identity(Words.of())["id"], 1)
        self.assertEqual(board.core.resets, 0)

    def test_after_an_overrun_while_it_stores_it_restarts_and_hears_again(self):
        board = self.configured(self.BOARD.booted())
        state = Words.of()["ticks"][1]["states"][1][0]["serial"]
        board.tell(Words.of()["store"] + state * 1200)
        board.ms(900)
        stored = [frame for frame in board.frames() if kind(frame) == STORED]
        self.assertIn("ok", read(stored)[0]["stored"])
        self.assertEqual(board.core.resets, 1)
        identity = board.identity(Words.of())
        self.assertEqual((identity["id"], identity["reset"], identity["starts"]), (1, "Software", 2))


class OnCan(Commissioned):
    """A node with its states on CAN."""

    def pair(self):
        boards = [self.configured(self.BOARD.booted(serial=index + 1), index) for index in range(2)]
        return Bus(boards)

    def test_two_nodes_run_the_bits_of_loopback(self):
        bus, delays = self.pair(), []
        bus.start(Words.of())
        ticks = Words.of()["ticks"]
        for tick in range(len(ticks) - 1):
            begin = bus.boards[0].core.ns
            bus.tick(Words.of(), tick)
            delays.append((bus.boards[0].can.sent_at[-1] - begin) / 1e3)
        print(f"{self.BOARD.image}: {len(delays)} ticks, state {min(delays):.1f} to {max(delays):.1f} us after SYNC")
        self.assertLess(max(delays) - min(delays), LARGEST_JITTER * TICK_US)
        for index, sent in enumerate(bus.sent):
            expected = [frame(component) for tick in ticks for component in tick["states"][index]]
            states = [each for each in sent if STATES[0] <= each.id >> 7 <= STATES[1]]
            self.assertEqual(states, expected)
        self.assertEqual([board.can.lost for board in bus.boards], [0, 0])

    def test_a_node_whose_clock_is_missing_goes_on_trying(self):
        board = self.BOARD()
        board.rcc.has_crystal = False
        board.ms(1100)
        self.assertGreaterEqual(board.core.resets, 2)
        board.rcc.has_crystal = True
        board.ms(600)
        identity = board.identity(Words.of())
        self.assertEqual(identity["reset"], "PowerOn", "no start before this one has come as far as to count")
        board.ms(3000)
        self.assertIsNotNone(board.identity(Words.of()), "and its watchdog goes on with its own period")

    def test_it_comes_back_from_bus_off(self):
        board = self.configured(self.BOARD.booted())
        bus = Bus([board])
        bus.start(Words.of())
        begin = board.core.ns
        board.can.go_off()
        while board.can.is_off and board.core.ns < begin + 1e9:
            bus.run(1e6)
        self.assertFalse(board.can.is_off)
        self.assertGreaterEqual(board.core.ns - begin, 100e6, "it has not waited")
        bus.run(50e6)
        # FAULT 5, once the bus is there again.
        self.assertTrue(any(sent.id >> 7 == 2 and sent.data[0] == 5 for sent in bus.sent[0]), bus.sent[0])
        self.assertEqual(board.core.resets, 0)
        self.assertEqual(board.identity(Words.of())["id"], 1)

    def test_foreign_frames_at_line_rate_reset_nothing_and_are_counted(self):
        board = self.configured(self.BOARD.booted())
        draw, end, count = random.Random(1), board.core.ns + settings.flood_ms() * 1e6, 0
        while board.core.ns < end:
            frame = drawn(draw)
            board.run(line_bits(frame) * 1e3)
            board.can.receive(frame)
            count += 1
        board.ms(20)
        self.assertEqual(board.core.resets, 0)
        counters = board.ask(Words.of()["report"], REPORT)["report"]["counters"]
        heard = counters["accepted"] + sum(counters["refused"])
        print(f"{board.image}: {count} foreign frames, {board.can.refused} filtered out, {heard} counted by the node, {board.can.lost} lost by the controller")
        self.assertGreater(heard, 0)
        self.assertEqual(heard + board.can.refused + board.can.lost, count)


def drawn(draw):
    """Any legal frame: each function code with each node, DLC 0 to 15, 11 and 29 bits, data and remote."""
    is_extended, is_remote, dlc = draw.random() < 0.2, draw.random() < 0.2, draw.randrange(16)
    identifier = draw.randrange(1 << 29) if is_extended else draw.randrange(16) << 7 | draw.randrange(4)
    data = b"" if is_remote else draw.randbytes(min(dlc, 8))
    return Frame(identifier, data, is_extended, is_remote, dlc)


def line_bits(frame):
    """Bits of a frame on the bus with the pause after it, without stuffing: the shortest that it can be."""
    return (67 if frame.is_extended else 47) + 8 * len(frame.data)
