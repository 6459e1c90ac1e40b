"""What the tests of several boards expect alike. Mixed into a `unittest.TestCase` with BOARD, the class of the board."""

import random

from board import kind
from bus import Bus
from core import PowerCut
from even import LARGEST_JITTER, TICK_US, Even, tick_of, width
from fdcan import Frame
import settings
from usart import FRAMING, NOISE
from words import CONFIGURED, IDENTITY, REPORT, STAGED, STATE, STORED, Words, read, words

STRANGERS = "scenarios/five-agents.toml"
DEPTHS = (0, 0.5, 1)
# Function codes of states on CAN.
STATES = 3, 11
FLOOD_NS = 1e9


class Commissioned:
    """A node that stores, whatever its bus."""

    # Whether its storage is behind its program.
    IS_STORAGE_LAST = True

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

    def test_flashing_it_anew_leaves_its_configuration_unless_a_file_without_addresses_spans_it(self):
        storage, wanted = self.stored().storage(), Words.of()["nodes"][0]["checksum"]
        for is_flat in (False, True):
            with self.subTest(is_flat=is_flat):
                board = self.BOARD(storage=storage)
                board.core.flash_anew(is_flat)
                board.ms(self.BOARD.boot_ms)
                identity = board.identity(Words.of())
                keeps = self.IS_STORAGE_LAST or not is_flat
                self.assertEqual((identity["id"], identity["checksum"] == wanted), (1, True) if keeps else (0, False))

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

    def test_a_debugger_that_was_unplugged_holds_up_nothing(self):
        board = self.configured(self.BOARD.booted())
        board.core.leave_debugger()
        before = board.core.log_words()
        self.start(board)
        board.ms(5)
        self.assertNotEqual(board.core.log_words(), before, "nothing was logged: the test shows nothing")
        self.assertEqual(board.identity(Words.of())["id"], 1)
        board.ms(3000)
        self.assertEqual(board.core.resets, 0)

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


class OnLine(Even, Commissioned):
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

    def start(self, board):
        board.tell(Words.of()["start"]["serial"])

    def lost(self, board):
        return board.uart.overruns

    def with_traffic(self, board, ticks, tick_us=TICK_US, at=lambda tick: None):
        """Runs a node among states of its neighbour, states of strangers and noise, and calls `at` in each period; the times of its
        states, us."""
        draw, period = random.Random(2), tick_us * 1e3
        words = Words.of(tick_of(tick_us), f"time.duration={(ticks + 10) * tick_us}us")["ticks"]
        strangers = [states[0]["serial"] for tick in self.strangers() for states in tick["states"][2:]]
        leaving, begin, said = state_times(board), board.core.ns, 0
        for tick in range(ticks):
            at(tick)
            board.run(begin + (tick + draw.random() * 0.3) * period - board.core.ns)
            board.tell(words[tick + 1]["states"][1][0]["serial"])
            said += 1
            while board.core.ns < begin + (tick + 0.8) * period:
                other = draw.choice(strangers) if draw.random() < 0.5 else noise(draw)
                board.tell(other)
                board.run(len(other) / 2 * board.line.byte_ns)
                said += 1
        board.run(begin + ticks * period - board.core.ns)
        # Not those beside a reply: it takes the same line, and the state waits for it.
        times = list(leaving)
        counters = self.counters(board)
        print(f"{board.image}: {said} frames on its line in {ticks} ticks, {counters['accepted']} accepted, {sum(counters['refused'])} refused")
        # The start is one, too.
        self.assertEqual(counters["accepted"] + sum(counters["refused"]), said + 1)
        return times

    def test_with_a_period_of_two_milliseconds_its_ticks_are_even_whatever_its_clock(self):
        times, _ = self.row("configure_by_timer", 2 * TICK_US)
        self.assertLess(width(times, 2 * TICK_US), LARGEST_JITTER * 2 * TICK_US)

    @staticmethod
    def strangers():
        """What nodes that are no neighbours say: frames that are whole, and not for it."""
        return words(STRANGERS, "time.duration=10ms")["ticks"]

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


def state_times(board):
    """The times at which its states will have left, us: a list that grows as it speaks."""
    times, frame, keep = [], bytearray(), board.uart.on_byte

    def on_byte(byte):
        keep(byte)
        if byte:
            frame.append(byte)
            return
        if len(frame) > 1 and kind(frame) == STATE:
            times.append(board.uart.byte_at / 1e3)
        frame.clear()

    board.uart.on_byte = on_byte
    return times


def noise(draw):
    """A frame of drawn bytes, as hexadecimal digits."""
    return bytes(draw.randrange(1, 256) for _ in range(draw.randrange(2, 30))).hex() + "00"


class Counted:
    """A node whose lines count errors, and fall silent or not."""

    def test_a_frame_on_a_line_that_does_not_fall_silent_is_answered_at_once(self):
        board, hello = self.BOARD.booted(), Words.of()["hello"]
        rounds, answer, noise = 8, 100, 150
        # At several moments of what else wakes it; less than half of the driver's buffer, which would wake its reader.
        board.tell((hello + "01" * noise + "00") * rounds)
        begin, length = board.core.ns, len(hello) // 2 + noise + 1
        for index in range(rounds):
            board.run(begin + (index * length + len(hello) // 2 + answer) * board.line.byte_ns - board.core.ns)
            self.assertTrue(board.line.queue, "the line is silent: the test shows nothing")
            self.assertEqual([kind(frame) for frame in board.frames()], [IDENTITY] * (index + 1))

    def errors_are_counted(self, board, uart, before):
        """Noise, a wrong stop bit, both at one byte and an overrun of several bytes come on a line, and each counts as one, beside those that
        were `before`; gives how many there are then."""
        for errors in (NOISE, FRAMING, NOISE | FRAMING):
            uart.feed(0, errors)
            board.ms(1)
        for _ in range(uart.depth + 3):
            uart.feed(0)
        board.ms(5)
        board.tell("00")
        report = board.ask(Words.of()["report"], REPORT)["report"]["counters"]
        self.assertEqual(report["link"]["line_errors"], before + 4)
        return before + 4


class OnLines(Counted):
    """Nodes with lines to each other, the last of one to the last of the other; each has a host."""

    def test_two_nodes_on_a_line_to_each_other_run_the_bits_of_loopback(self):
        boards = [self.BOARD.booted(serial=index + 1) for index in range(2)]
        ticks, said = Words.of()["ticks"][:101], [bytearray(), bytearray()]
        for board, node, other, said_by in zip(boards, Words.of()["nodes"], reversed(boards), said):
            self.assertEqual(board.ask(node["configure"], CONFIGURED)["configured"], {"ok": None})
            uart, (_, wire) = board.peers[-1][0], other.peers[-1]
            uart.on_byte = lambda byte, wire=wire, said_by=said_by: (said_by.append(byte), wire.push([byte]))
        tell_all(boards, Words.of()["start"]["serial"])
        for tick in ticks[:-1]:
            tell_all(boards, tick["sync"]["serial"])
        for index, said_by in enumerate(said):
            states = [frame.hex() + "00" for frame in bytes(said_by).split(b"\0") if frame and kind(frame) == STATE]
            self.assertEqual(states, [tick["states"][index][0]["serial"] for tick in ticks])
        self.assertEqual([uart.overruns for board in boards for uart, _ in board.peers], [0] * 2 * len(boards[0].peers))


def tell_all(boards, text):
    """Says the same to all at once, and runs them for a tick, none ahead of another by more than a few bytes."""
    for board in boards:
        board.tell(text)
    end = max(board.core.ns for board in boards) + 1e6
    while min(board.core.ns for board in boards) < end:
        for board in boards:
            board.run(50e3)


class OnCan(Even, Commissioned, Counted):
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
            expected = [bus.boards[0].frame(component) for tick in ticks for component in tick["states"][index]]
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

    def test_a_second_of_any_legal_frames_at_line_rate_resets_nothing_and_each_is_counted(self):
        board = self.configured(self.BOARD.booted())
        draw, end, count, foreign, seen = random.Random(1), board.core.ns + FLOOD_NS, 0, 0, set()
        while board.core.ns < end:
            frame = drawn(draw)
            seen |= kinds(frame)
            board.run(line_bits(frame) * 1e3)
            board.can.receive(frame)
            count, foreign = count + 1, foreign + (not is_for(frame, 1, 2))
        board.ms(20)
        self.assertEqual(board.core.resets, 0)
        counters = self.counters(board)
        heard = counters["accepted"] + sum(counters["refused"])
        self.assertEqual(seen, every_kind(), "the draw has left something out")
        print(f"{board.image}: {count} frames in {FLOOD_NS / 1e9} s, {board.can.refused} filtered out, {heard} counted by the node, "
              f"{board.can.lost} lost by the controller, {counters['link']['frames']} losses counted")
        self.assertEqual(board.can.refused, foreign, "the filters let in what is for node 1 with the neighbour 2")
        self.assertEqual(heard, count - foreign)
        self.assertEqual((board.can.lost, counters["link"]["frames"]), (0, 0))

    def lets_in(self, board, function, node):
        """Whether the controller lets in a frame with this identifier."""
        before = board.can.refused
        board.can.receive(Frame(function << 7 | node, bytes(8)))
        board.ms(1)
        return board.can.refused == before

    def test_a_commit_that_changes_the_neighbours_changes_the_filters(self):
        board = self.BOARD.booted()
        self.assertTrue(self.lets_in(board, STATES[0], 77), "a blank node hears all")
        self.configured(board)
        heard = lambda: [node for node in range(1, 128) if self.lets_in(board, STATES[0], node)]
        self.assertEqual(heard(), [1, 2])
        board.ask(Words.of()["nodes"][0]["stage_moved"], STAGED)
        self.assertEqual(heard(), [1, 2])
        board.tell(Words.of()["commit"]["serial"])
        board.ms(600)
        self.assertEqual(heard(), [1, 3])

    def test_frames_that_the_controller_has_no_room_for_are_noticed(self):
        board = self.configured(self.BOARD.booted())
        # At one moment: nobody could take them out in time.
        for tick in range(5):
            board.can.receive(board.frame(Words.of()["ticks"][tick]["states"][1][0]))
        board.ms(5)
        counters = self.counters(board)
        self.assertEqual((board.can.lost, counters["link"]["frames"]), (2, 1), "the controller tells of a loss, not of how many")
        self.assertEqual(counters["accepted"] + sum(counters["refused"]), 3)
        self.configured(board)
        self.assertEqual(self.counters(board)["link"]["frames"], 0, "counted since the configuration")

    def test_frames_that_come_while_it_stores_are_heard_or_counted(self):
        board = self.configured(self.BOARD.booted())
        board.tell(Words.of()["store"])
        state, count = board.frame(Words.of()["ticks"][1]["states"][1][0]), 8000
        begin, period = board.core.ns, line_bits(state) * 1e3
        for at in (begin + index * period for index in range(count)):
            # The core may stand still for longer than a frame.
            board.run(max(at - board.core.ns, 0))
            board.can.receive(state)
        board.ms(50)
        counters = self.counters(board)
        heard, lost = counters["accepted"] + sum(counters["refused"]), counters["link"]["frames"]
        print(f"{board.image}: {count} frames while it stores, {heard} heard, {board.can.lost} lost by the controller, {lost} losses counted")
        self.assertGreater(lost, 0, "nothing was lost: the test shows nothing")
        # Each that the node had no room for; of the controller's, the times.
        by_node = count - heard - board.can.lost
        self.assertGreaterEqual(by_node, 0)
        self.assertTrue(by_node <= lost <= count - heard and (lost > by_node) == (board.can.lost > 0), f"{by_node} lost by the node itself")
        self.assertEqual(board.core.resets, 0)

    def test_errors_on_the_bus_and_on_the_line_are_counted(self):
        board = self.configured(self.BOARD.booted())
        self.assertEqual([self.counters(board)["link"][name] for name in ("bus_errors", "line_errors")], [0, 0])
        for _ in range(7):
            board.can.error()
            board.ms(1)
        self.assertEqual(self.counters(board)["link"]["bus_errors"], 7)
        self.errors_are_counted(board, board.uart, 0)

    def start(self, board):
        board.can.receive(board.frame(Words.of()["start"]))

    def lost(self, board):
        return board.can.lost

    def with_traffic(self, board, ticks, tick_us=TICK_US, at=lambda tick: None):
        """Runs a node among states of its neighbour and frames of others, with ticks of 1 ms, and calls `at` in each period; the times of its states, us."""
        self.assertEqual(tick_us, TICK_US)
        draw, words = random.Random(2), Words.of()["ticks"]
        board.can.sent_at.clear()
        begin = board.core.ns
        for tick in range(ticks):
            at(tick)
            board.run(begin + tick * 1e6 + draw.random() * 3e5 - board.core.ns)
            board.can.receive(at_tick(board.frame(words[1]["states"][1][0]), tick + 1))
            while board.core.ns < begin + tick * 1e6 + 9e5:
                other = drawn(draw)
                board.run(line_bits(other) * 1e3)
                if not steers(other):
                    board.can.receive(other)
        board.run(begin + ticks * 1e6 - board.core.ns)
        return [at / 1e3 for at, sent in zip(board.can.sent_at, board.can.sent) if STATES[0] <= sent.id >> 7 <= STATES[1]]

    def test_a_line_that_is_too_slow_for_telemetry_delays_no_tick(self):
        self.assertGreater(self.jitter("configure_telling")["link"]["unsaid"], 0)


def at_tick(state, tick):
    """A state with another stamp: 16 bits after two bytes in the format of CAN FD, else its last byte."""
    if state.is_fd:
        return state._replace(data=state.data[:2] + (tick & 0xFFFF).to_bytes(2, "little") + state.data[4:])
    return state._replace(data=state.data[:-1] + bytes([tick & 0xFF]))


def steers(frame):
    """Whether a running node may stop because of a drawn frame: a command, a state with its own number, a state of its neighbour with a wild value."""
    is_of_plane = not frame.is_extended and not frame.is_remote
    return is_of_plane and (frame.id >> 7 < 2 or frame.id & 0x7F == 1 or frame.id & 0x7F == 2 and frame.id >> 7 <= STATES[1])


def is_for(frame, own, neighbour):
    """Whether a node wants a frame: what all may say to all (CTRL, SYNC, FAULT, EDGE), and what its neighbours say, and its twin."""
    is_of_plane = not frame.is_extended and not frame.is_remote
    return is_of_plane and (frame.id >> 7 in (0, 1, 2, 12) or frame.id & 0x7F in (own, neighbour))


def drawn(draw):
    """Any legal frame: each function code with each node, DLC 0 to 15, 11 and 29 bits, data and remote."""
    is_extended, is_remote, dlc = draw.random() < 0.2, draw.random() < 0.2, draw.randrange(16)
    identifier = draw.randrange(1 << 29) if is_extended else draw.randrange(16) << 7 | draw.randrange(4)
    data = b"" if is_remote else draw.randbytes(min(dlc, 8))
    return Frame(identifier, data, is_extended, is_remote, dlc)


def kinds(frame):
    """What a drawn frame is one of: a DLC in its format, and a function code with a node."""
    shape = frame.is_extended, frame.is_remote
    return {(*shape, frame.dlc), *([] if frame.is_extended else [(*shape, frame.id >> 7, frame.id & 0x7F)])}


def every_kind():
    """Of those, all that there are: each with nobody, with both nodes and with a stranger."""
    flags = False, True
    dlcs = {(is_extended, is_remote, dlc) for is_extended in flags for is_remote in flags for dlc in range(16)}
    return dlcs | {(False, is_remote, function, node) for is_remote in flags for function in range(16) for node in range(4)}


def line_bits(frame):
    """Bits of a frame on the bus with the pause after it, without stuffing: the shortest that it can be."""
    return (67 if frame.is_extended else 47) + 8 * len(frame.data)
