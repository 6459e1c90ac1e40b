#!/usr/bin/env python3
"""Runs target/.../selftest in QEMU: echo without loss, a ticker that is right, and defects that are reported.

usage: selftest.py QEMU DECODER CONFIGS IMAGE

DECODER IMAGE < LOG prints a defmt log; CONFIGS prints a line for each configuration, its name and its bytes.
"""
import binascii, json, pathlib, random, re, socket, struct, subprocess, sys, tempfile, time, zlib

import stack

QEMU, DECODER, CONFIGS, IMAGE = sys.argv[1:5]
TIMEOUT = 60.0
# Node 3 with the timer as tick source, 1 ms, one edge of weight 1 to node 2, constant funnel of 10; and what differs from it.
CONFIG = {name: bytes.fromhex(body) for name, body in
          (line.split() for line in subprocess.run([CONFIGS], check=True, capture_output=True, text=True).stdout.splitlines())}
NODE_CONFIG = CONFIG["plain"]
# What the image has to overflow its stack with, when it is told to.
OVERFLOWS = re.compile(r"selftest::overflow_stack|FnOnce::call_once")


class Node:
    """One emulated board. The script listens and QEMU connects, so that no byte goes unheard."""

    def __init__(self, *options):
        self.folder = tempfile.TemporaryDirectory(prefix="selftest-")
        folder = pathlib.Path(self.folder.name)
        self.log_file = folder / "log"
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(str(folder / "uart"))
        listener.listen(1)
        listener.settimeout(TIMEOUT)
        self.process = subprocess.Popen([
            QEMU, "-M", "mps2-an386", "-kernel", IMAGE, "-display", "none", "-monitor", "none",
            "-qmp", f"unix:{folder / 'qmp'},server=on,wait=off",
            "-chardev", f"socket,id=uart,path={folder / 'uart'}", "-serial", "chardev:uart",
            # A chardev for semihosting gets only SYS_WRITEC and SYS_WRITE0: what is written to the opened
            # console (":tt", as defmt-semihosting does) goes to QEMU's own standard output.
            "-semihosting-config", "enable=on,target=native", *options], stdout=self.log_file.open("wb"))
        try:
            self.link, _ = listener.accept()
        except OSError:
            self.process.kill()
            raise
        listener.close()
        self.link.settimeout(TIMEOUT)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.link.close()
        self.process.kill()
        self.process.wait()
        self.folder.cleanup()

    def receive(self, count):
        data = b""
        while len(data) < count:
            more = self.link.recv(count - len(data))
            if not more:
                raise EOFError(f"link closed after {len(data)} of {count} bytes")
            data += more
        return data

    def restart(self):
        """Resets the machine, as its button does. What is in RAM stays there."""
        self.control({"execute": "system_reset"})

    def stack_used(self):
        """Bytes of stack that were ever written: an emulated RAM is zero at first."""
        dump, end = pathlib.Path(self.folder.name) / "stack", stack.symbol(IMAGE, "_stack_start")
        size = end - stack.symbol(IMAGE, "_stack_end")
        arguments = {"val": end - size, "size": size, "filename": str(dump)}
        self.control({"execute": "pmemsave", "arguments": arguments})
        return size - next(at for at, byte in enumerate(dump.read_bytes()) if byte)

    def control(self, *requests):
        """Asks QEMU, not the machine."""
        with socket.socket(socket.AF_UNIX) as control:
            control.settimeout(TIMEOUT)
            control.connect(str(pathlib.Path(self.folder.name) / "qmp"))
            lines = control.makefile()
            lines.readline()  # its greeting
            for request in ({"execute": "qmp_capabilities"}, *requests):
                control.sendall(json.dumps(request).encode() + b"\n")
                while "return" not in (answer := json.loads(lines.readline())):
                    assert "event" in answer, answer

    def ask(self, kind, body, answer):
        """Sends a request, and expects exactly this frame."""
        self.link.sendall(frame(kind, 0, body))
        got = self.receive(len(answer))
        assert got == answer, got.hex()

    def log(self):
        return subprocess.run([DECODER, IMAGE], input=self.log_file.read_bytes(), capture_output=True, check=True,
                              timeout=TIMEOUT).stdout.decode()


def echo(*options):
    source = random.Random(1)
    sent = source.randbytes(10_000)
    with Node(*options) as node:
        node.link.sendall(b"e")
        start, at, got = time.monotonic(), 0, b""
        while at < len(sent):
            burst = sent[at:at + source.randint(20, 800)]
            at += len(burst)
            node.link.sendall(burst)
            got += node.receive(len(burst))
        assert got == sent, "the echo differs"
        return f"{len(sent)} bytes there and back in {time.monotonic() - start:.2f} s"


def echo_in_one_piece(*options):
    sent = random.Random(2).randbytes(10_000)
    with Node(*options) as node:
        node.link.sendall(b"e" + sent)
        assert node.receive(len(sent)) == sent, "the echo differs"
        return f"{len(sent)} bytes in one burst"


def ticker(most_late_us, *options):
    with Node(*options) as node:
        node.link.sendall(b"t")
        took, late = struct.unpack("<II", node.receive(8))
        assert 1_000_000 <= took <= 1_000_000 + most_late_us and late <= most_late_us, (took, late)
        return f"1000 periods of 1 ms took {took} us, the latest {late} us late"


def long_wait(*options):
    with Node(*options) as node:
        node.link.sendall(b"w")
        took, = struct.unpack("<Q", node.receive(8))
        assert 0 <= took - 1_000_000_000 <= 20, took
        return f"1000 s of virtual time took {took} us"


def bulk():
    """Doesn't read at first, so that the transmit buffer fills and the node must wait for its interrupt."""
    with Node() as node:
        node.link.sendall(b"b")
        time.sleep(1.0)
        got = node.receive(1_000_000)
        assert got == bytes(i & 0xFF for i in range(1_000_000)), "the bytes differ"
        return f"{len(got)} bytes against back pressure"


def overflow():
    sent = random.Random(3).randbytes(3000)
    with Node() as node:
        node.link.sendall(b"o" + sent)
        lost, = struct.unpack("<I", node.receive(4))
        assert lost == len(sent) - 2048, lost
        assert node.receive(2048) == sent[:2048], "what was kept differs"
        return f"{lost} of {len(sent)} bytes lost and counted, the first 2048 kept"


def defect(command, code, expected, *options):
    with Node(*options) as node:
        node.link.sendall(command)
        ended = node.process.wait(timeout=TIMEOUT)
        log = node.log()
        assert ended == code and expected in log, (ended, log)
        return f"exit code {ended}, log: {log.strip().splitlines()[-1]}"


def cobs(raw):
    """COBS of less than 254 bytes, with its final zero."""
    return b"".join(bytes([len(block) + 1]) + block for block in raw.split(b"\0")) + b"\0"


def frame(kind, source, body):
    raw = bytes([kind, source]) + body
    return cobs(raw + struct.pack(">H", binascii.crc_hqx(raw, 0xFFFF)))


def bus_off():
    """The node stops, says so on the serial line at once, and on CAN when the controller is back."""
    fault = b"\x05\x02\x01\x00"  # code 5, stopped, once
    with Node(*ICOUNT) as node:
        node.link.sendall(b"c" + frame(0x42, 0, NODE_CONFIG))
        assert node.receive(len(frame(0x43, 3, b"\0"))) == frame(0x43, 3, b"\0"), "the configuration is refused"
        node.link.sendall(frame(0x10, 0, b"\x00\x01\x00\x00\x00"))
        said = node.receive(12)
        expected = [frame(0x12, 3, fault + struct.pack("<H", tick)) for tick in range(45, 75)]
        assert said in expected, said.hex()
        log = wait_for(node, "CAN takes 0x103")
        order = ["started", "hears node 2", "CAN takes 0x603", "CAN drops", "link: Off { count: 1, wait_ms: 100 }",
                 "its CAN controller went off the bus", "CAN restarts", "link: Back", "CAN takes 0x103"]
        places = [log.find(text) for text in order]
        assert -1 not in places and places == sorted(places), log
        return "the node stops, and tells it after the recovery"


def can_fd():
    """Both components of the state in one frame; those of a neighbour are taken from one."""
    with Node(*ICOUNT) as node:
        node.link.sendall(b"d" + frame(0x42, 0, CONFIG["two-components"]))
        assert node.receive(len(frame(0x43, 3, b"\0"))) == frame(0x43, 3, b"\0"), "the configuration is refused"
        node.link.sendall(frame(0x10, 0, b"\x00\x01\x00\x00\x00"))
        log = wait_for(node, "CAN takes 0x103")  # its FAULT, after the recovery
        order = ["CAN takes a state of 12 bytes, 0x583", "hears node 2", "CAN restarts"]
        places = [log.find(text) for text in order]
        assert -1 not in places and places == sorted(places), log
        return "two components in a frame of 12 bytes, both ways"


def commissioning():
    """A blank node is configured and stores; after a reset it has its id and starts; erased, it is blank after the next."""
    starts = iter((1, 2, 3, 5))  # those that are asked
    # What the chip does not tell it can guess for the first start only, by its RAM.
    identity = lambda id: frame(0x41, id, identity_body(id, POWER_ON if (n := next(starts)) == 1 else UNKNOWN, n))
    with Node() as node:
        node.link.sendall(b"s")
        node.ask(0x40, b"", identity(0))
        node.ask(0x47, b"", frame(0x48, 0, b"\1\1"))  # nothing to store yet
        node.ask(0x42, NODE_CONFIG, frame(0x43, 3, b"\0"))
        restart(node)
        node.ask(0x40, b"", identity(0))  # CONFIGURE is volatile
        node.ask(0x42, NODE_CONFIG, frame(0x43, 3, b"\0"))
        node.ask(0x47, b"", frame(0x48, 3, b"\0\1"))  # epoch 1
        restart(node)
        node.ask(0x40, b"", identity(3))
        # Start: its state at tick 0, which is the configuration's.
        node.ask(0x10, b"\x00\x01\x00\x00\x00", frame(0x13, 3, struct.pack("<Hf", 0, 1.0)))
        restart(node)
        node.ask(0x49, b"", frame(0x4A, 3, b"\0"))
        restart(node)
        node.ask(0x40, b"", identity(0))
        assert node.log().count("configured from storage: node 3") == 2, node.log()
        used, most = node.stack_used(), stack.bound(IMAGE, OVERFLOWS).total
        assert 4000 < used <= most, (used, most)
        return f"stored, restarted, joined; erased, restarted, blank; {used} bytes of stack of at most {most}"


def commit(at=0):
    return frame(0x10, 0, b"\0\3\0" + struct.pack("<H", at))


def stage(node, id, config):
    node.ask(0x4B, config, frame(0x4C, id, b"\0" + varint(zlib.crc32(config))))


def staged_commissioning():
    """What is staged counts from its commit on and not before, and its key stays until it is erased."""
    now, next = CONFIG["told-10"], CONFIG["told-20"]
    with Node() as node:
        def is_now(id, config, has_key, starts):
            checksum = zlib.crc32(config) if config else 0
            reset = POWER_ON if starts == 1 else UNKNOWN
            node.ask(0x40, b"", frame(0x41, id, identity_body(id, reset, starts, checksum, has_key)))

        node.link.sendall(b"s")
        stage(node, 0, now)
        is_now(0, None, False, 1)
        restart(node)
        node.link.sendall(commit())  # the power was cut in between: nothing is staged any more
        is_now(0, None, False, 2)
        stage(node, 0, now)
        node.link.sendall(commit())
        is_now(3, now, False, 2)
        restart(node)
        is_now(3, now, False, 3)
        node.ask(0x4D, bytes(range(16)), frame(0x4E, 3, b"\0\2"))  # epoch 2
        is_now(3, now, True, 3)
        stage(node, 3, next)
        restart(node)
        is_now(3, now, True, 4)
        stage(node, 3, next)
        node.link.sendall(commit())
        is_now(3, next, True, 4)
        restart(node)
        is_now(3, next, True, 5)
        node.ask(0x49, b"", frame(0x4A, 3, b"\0"))
        restart(node)
        is_now(0, None, False, 6)
        return "staged, committed, restarted: the old one or the new one, with its key"


def commit_at_a_tick(tick=60):
    """A running node has the new funnel from the tick on that the commit has named, and after a restart, too.

    In real time, as in fed_watchdog. On a busy computer ticks come late; of those that are made up for nobody is told."""
    now, next = CONFIG["slow-10"], CONFIG["slow-20"]
    with Node() as node:
        node.link.sendall(b"s")
        stage(node, 0, now)
        node.link.sendall(commit())
        stage(node, 3, next)
        node.link.sendall(frame(0x10, 0, b"\0\1\0\0\0") + commit(tick))
        widths, states = {}, []
        while not widths or max(widths) < tick + 20:
            kind, _, body = read_frame(node)
            assert kind in (0x13, 0x1C, 0x44), (hex(kind), body.hex())  # states, edges, telemetry; no fault
            if kind == 0x44:
                at, rest = read_varint(body)
                widths[at] = struct.unpack("<f", rest[5:9])[0]
            elif kind == 0x13:
                states.append(struct.unpack("<Hf", body)[0])
        node.link.sendall(frame(0x10, 0, b"\0\2\0\0\0"))
        wait_for(node, "stopped by command")
        assert widths == {at: 10.0 if at < tick else 20.0 for at in widths}, widths
        before, after = max(at for at in widths if at < tick), min(at for at in widths if at >= tick)
        assert states == sorted(set(states)), states
        restart(node)
        node.ask(0x40, b"", frame(0x41, 3, identity_body(3, UNKNOWN, 2, zlib.crc32(next))))
        return f"psi 10 up to tick {before}, 20 from {after} on, {len(widths)} of {max(widths) + 1} ticks told"


def read_frame(node):
    """Kind, source and body of the next frame."""
    coded = b""
    while not coded.endswith(b"\0"):
        coded += node.receive(1)
    raw = b""
    while len(coded) > 1:
        raw, coded = raw + coded[1:coded[0]] + b"\0", coded[coded[0]:]
    raw = raw[:-1]
    assert binascii.crc_hqx(raw, 0xFFFF) == 0, raw.hex()
    return raw[0], raw[1], raw[2:-2]


def varint(number):
    """As postcard writes it."""
    out = b""
    while number >= 0x80:
        out, number = out + bytes([number & 0x7F | 0x80]), number >> 7
    return out + bytes([number])


def read_varint(body):
    number = 0
    for at, byte in enumerate(body):
        number |= (byte & 0x7F) << 7 * at
        if byte < 0x80:
            return number, body[at + 1:]
    raise ValueError(body.hex())


# service::ResetCause
UNKNOWN, POWER_ON, WATCHDOG, PANIC, HARD_FAULT = 0, 1, 4, 6, 7


def identity_body(id, reset, starts, checksum=None, has_key=False):
    checksum = (zlib.crc32(NODE_CONFIG) if id else 0) if checksum is None else checksum
    return bytes([3, 0, 1, 0, id, 0, reset, starts]) + varint(checksum) + bytes([has_key])


def restart_after_defect(command, cause, arg, logged):
    """A commissioned node makes its output safe, restarts, is ready, says FAULT 3 as a warning, and does not run."""
    with Node() as node:
        node.link.sendall(b"s")
        node.ask(0x42, NODE_CONFIG, frame(0x43, 3, b"\0"))
        node.ask(0x47, b"", frame(0x48, 3, b"\0\1"))
        restart(node, b"")
        node.link.sendall(command)
        await_ready(node, 3)
        node.link.sendall(b"s")
        fault = frame(0x12, 3, bytes([3, 1, arg, 0, 0, 0]))
        said = node.receive(len(fault))
        assert said == fault, said.hex()
        node.ask(0x40, b"", frame(0x41, 3, identity_body(3, cause, 3)))
        # A SYNC or time alone does not make it run: all it says is what it is asked for.
        time.sleep(0.3)
        node.ask(0x40, b"", frame(0x41, 3, identity_body(3, cause, 3)))
        restart(node)
        node.ask(0x40, b"", frame(0x41, 3, identity_body(3, UNKNOWN, 4)))  # told once
        log = node.log()
        order = ["the output is safe", logged, "start 3, last reset: ", "configured from storage: node 3"]
        places = [log.find(text) for text in order]
        assert -1 not in places and places == sorted(places), log
        return log[places[2]:].splitlines()[0]


def stuck_tick():
    """The plant's fifth tick does not come back: the watchdog resets the node, which says why."""
    with Node() as node:
        node.link.sendall(b"x")
        node.ask(0x42, NODE_CONFIG, frame(0x43, 3, b"\0"))
        node.ask(0x40, b"", frame(0x41, 3, identity_body(3, POWER_ON, 1)))
        node.link.sendall(frame(0x10, 0, b"\x00\x01\x00\x00\x00"))
        await_ready(node, 2)
        drain(node)
        node.link.sendall(b"s")
        node.ask(0x40, b"", frame(0x41, 0, identity_body(0, WATCHDOG, 2)))
        return "reset, cause watchdog"


def fed_watchdog():
    """A node with its watchdog waits for ten periods and more, configured and not, and runs for three by its timer.

    It runs in real time: under ICOUNT the clock leaps ahead whenever the node waits for room on its line, which a busy computer makes it do."""
    with Node(*ICOUNT) as node:
        configured_with_watchdog(node, 2.0)
        assert node.log().count("selftest ready") == 1, node.log()
    with Node() as node:
        configured_with_watchdog(node, 0.0)
        node.link.sendall(frame(0x10, 0, b"\x00\x01\x00\x00\x00"))
        state = frame(0x13, 3, struct.pack("<Hf", 0, 1.0))
        node.receive(6 * len(state) * 1000)
        assert node.log().count("selftest ready") == 1, node.log()
        return "no reset in 6 s of a running node, nor while it waits"


def configured_with_watchdog(node, pause):
    """Commissions a node whose watchdog runs, and leaves it alone for a while before and after."""
    node.link.sendall(b"s")
    node.ask(0x40, b"", frame(0x41, 0, identity_body(0, POWER_ON, 1)))
    time.sleep(pause)
    node.ask(0x42, NODE_CONFIG, frame(0x43, 3, b"\0"))
    time.sleep(pause)


def priorities():
    """What a driver has set before, the executor has made equal."""
    with Node() as node:
        node.link.sendall(b"i")
        assert node.receive(1) == b"\1", "an interrupt precedes another"
        return "all interrupts have the same"


def await_ready(node, times):
    end = time.monotonic() + TIMEOUT
    while node.log().count("selftest ready") < times:
        assert time.monotonic() < end, node.log()
        time.sleep(0.1)


def restart(node, then=b"s"):
    seen = node.log().count("selftest ready")
    node.restart()
    await_ready(node, seen + 1)
    drain(node)
    node.link.sendall(then)


def drain(node):
    """Drops what it had sent before."""
    node.link.setblocking(False)
    try:
        while node.link.recv(4096):
            pass
    except BlockingIOError:
        pass
    node.link.settimeout(TIMEOUT)


def wait_for(node, text):
    end = time.monotonic() + TIMEOUT
    while text not in (log := node.log()):
        assert time.monotonic() < end, log
        time.sleep(0.1)
    return log


def idle():
    """An idle node must sleep, or a bench of them starves."""
    with Node() as node:
        stat = pathlib.Path(f"/proc/{node.process.pid}/stat")
        used = lambda: sum(int(field) for field in stat.read_text().rsplit(")", 1)[1].split()[11:13])
        time.sleep(0.5)
        before = used()
        time.sleep(1.0)
        ticks = used() - before
        assert ticks <= 20, f"{ticks} % of a core"
        return f"{ticks} % of a host core"


# Without sleep=off an idle machine waits in real time, and a host that wakes it late makes the tick late.
ICOUNT = ("-icount", "shift=0,sleep=off")
TESTS = {
    "echo": lambda: echo(),
    "echo, -icount": lambda: echo(*ICOUNT),
    "echo in one piece": lambda: echo_in_one_piece(),
    "ticker, -icount": lambda: ticker(20, *ICOUNT),
    "ticker, real time": lambda: ticker(500_000),
    "long wait, -icount": lambda: long_wait(*ICOUNT),
    "bulk": bulk,
    "overflow": overflow,
    "panic": lambda: defect(b"p", 101, "deliberate, as asked for"),
    "hard fault": lambda: defect(b"f", 102, "hard fault at pc"),
    "restart after panic": lambda: restart_after_defect(b"P", PANIC, 1, "deliberate, as asked for"),
    "restart after fault": lambda: restart_after_defect(b"F", HARD_FAULT, 2, "hard fault at pc"),
    "restart after overflow": lambda: restart_after_defect(b"O", HARD_FAULT, 2, "hard fault: the stack has overflowed"),
    "priorities": priorities,
    "stuck tick": stuck_tick,
    "fed watchdog": fed_watchdog,
    "bus-off": bus_off,
    "CAN FD": can_fd,
    "commissioning": commissioning,
    "staged commissioning": staged_commissioning,
    "commit at a tick": commit_at_a_tick,
    "idle": idle,
}
for name, test in TESTS.items():
    print(f"{name:24}", end="", flush=True)
    print(test(), flush=True)
print(f"selftest: {len(TESTS)} passed, 0 failed")
