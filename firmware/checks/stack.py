"""The deepest stack of linked images, against the room that they have. Run by ./ci.sh stack.

usage: stack.py IMAGE=BYTES...      BYTES: budget of the board

Every function's frame is read off its disassembly: all that it ever pushes or subtracts from the stack pointer, added up. The deepest path is
that through the call graph. A call through a pointer may be of any function whose address is somewhere in the image, which
makes groups of functions that could call each other in a circle. A circle of direct calls is refused, and so is one in which a function of
anyone but core::fmt is called by a pointer: it could be called anew on each turn. So each function of such a group counts once on a path; those
of core::fmt, which formats arguments while it formats, and those of a panic, which may happen in its own report, count twice.

On top comes the deepest interrupt handler with the frame that the processor stacks: all interrupts have the same priority
(firmware/src/priority.rs), so no handler interrupts another. An NMI interrupts it all the same, and a fault that, whose handler begins
the stack anew (firmware/src/panic.rs): on top comes its frame, and its own depth is stated beside and has to fit alone.
The panic handler is part of the graph. What is not seen: the boot ROM of the RP2040, allowed for by ROM_BYTES. Where an image is over its
budget, its deepest path is printed.
"""

import collections
import re
import struct
import sys

from image import FUNCTION, INSTRUCTION, Image, function_ends, section_bytes, tool

# What an exception stacks: 8 words, with FPU 18 more, and a word of alignment.
EXCEPTION = {"v6": 36, "v7e": 108}
# For the functions in the boot ROM of the RP2040 that write flash. Not documented; RAM that they need is not ours to read.
ROM_BYTES = 256
# Of core::fmt, or what is formatted by it; as names are read, not as they are mangled.
FORMATS = re.compile(r"\bcore(\[[0-9a-f]+\])?::fmt::")
# Called by a pointer, and calls by pointers itself: a channel or a USB class wakes a task, or runs a closure of its own, and functions in RAM call the boot ROM;
# none comes back.
RETURNS = re.compile(r"\bembassy_sync::channel::|\bembassy_usb::class::cdc_acm::Control\b|\bembassy_rp::flash::ram_helpers::")
NOTHING = re.compile("(?!)")
# The task's function, whose address is in its header, and who reads that.
POLL = re.compile(r"TaskStorage.*4poll")
EXECUTOR = re.compile(r"(?:8executor|8platform6thread)8Executor3run")
# How the stack pointer goes down, as (mnemonic, operands); the group is the number or the list of registers.
PUSH = re.compile(r"^(?:push|stmdb)(?:\.w)?$")
IMMEDIATE = re.compile(r"^sp,(?: sp,)? #(\d+)")
DOWN = re.compile(r"\[sp, #-(\d+)\]!")
# Instructions that change no register that is looked at here, or restore it.
READS = ("str", "cmp", "cmn", "tst", "b", "cb", "ldm", "stm", "pop", "vldm", "vstm", "vpop", "vstr", "vldr", "vcmp", "udf", "nop", "it", ".")
# A register holds a place on the stack.
SP = "sp"
# Or the stack pointer without its last bits, by a shift to the right and, where it is whole again, one to the left: a buffer that is aligned.
Rounded = collections.namedtuple("Rounded", "bits is_whole")
UNWIND = "rust_begin_unwind"
THUNK = re.compile(r"^__Thumb\w*Thunk_(.+)$")
# Numbers of exceptions, and how many there are at most.
NMI, FAULT = 2, 3
HANDLERS = 256


class Stacks(Image):
    """An image with the frame of each function."""

    def __init__(self, path):
        super().__init__(path)
        self.add_code_in_ram()
        self.words = self.all_words()
        names = tool("c++filt", input="\n".join(self.names.values()), text=True).splitlines()
        self.plain = dict(zip(self.names, names, strict=True))
        self.frame = {start: self.frame_of(start) for start in self.starts}
        self.taken = self.addresses_taken()

    def lines(self, addresses):
        """Not needed here, and slow."""
        return []

    def add_code_in_ram(self):
        """Functions that .data brings into RAM, which are not disassembled as code is."""
        for name in re.findall(r"^2[0-9a-f]{7} [tT] (\S+)$", tool("nm", self.path, text=True), re.M):
            text = tool("objdump", "-D", "--no-show-raw-insn", f"--disassemble={name}", self.path, text=True)
            for line in text.splitlines():
                if match := FUNCTION.match(line):
                    self.starts.append(int(match[1], 16))
                    self.names[self.starts[-1]] = match[2]
                elif match := INSTRUCTION.match(line):
                    self.code.append((int(match[1], 16), self.starts[-1], match[2], match[3] or ""))
        self.starts.sort()
        self.sites = [site for each in self.code if (site := self.site(*each))]

    def all_words(self):
        """Every aligned word of the image, by address."""
        words = {}
        table = tool("objdump", "-h", self.path, text=True)
        for name, address in re.findall(r"^ +\d+ (\.\S+) +[0-9a-f]{8} +([0-9a-f]{8})", table, re.M):
            if name not in (".vector_table", ".text", ".rodata", ".data"):
                continue
            data = section_bytes(self.path, name)
            for offset in range(0, len(data) // 4 * 4, 4):
                words[int(address, 16) + offset] = struct.unpack_from("<I", data, offset)[0]
        return words

    def frame_of(self, start):
        """Bytes that a function takes of the stack at most."""
        known = {}
        return sum(self.taken_by(address, mnemonic, operands, known) for address, _, mnemonic, operands in self.code_of(start))

    def code_of(self, start):
        if not hasattr(self, "by_function"):
            self.by_function = collections.defaultdict(list)
            for each in self.code:
                self.by_function[each[1]].append(each)
        return self.by_function[start]

    def taken_by(self, address, mnemonic, operands, known):
        """Bytes by which an instruction moves the stack pointer down. `known` is what registers hold: numbers, SP for a place on the stack, or that one Rounded."""
        if PUSH.match(mnemonic) and (mnemonic.startswith("push") or operands.startswith("sp!")):
            return 4 * registers(operands)
        if mnemonic.startswith("vpush"):
            return (8 if "d" in operands else 4) * registers(operands)
        if match := DOWN.search(operands):
            return int(match[1]) if mnemonic.startswith("str") else 0
        if mnemonic.startswith(READS):
            return 0
        if not re.match(r"^sp(,|$)", operands):
            self.note(mnemonic, operands, known)
            return 0
        if match := IMMEDIATE.match(operands):
            return int(match[1]) if mnemonic.startswith("sub") else 0
        register = re.match(r"^sp,(?: sp,)? (\w+)$", operands)
        held = known.get(register[1]) if register else None
        if mnemonic.startswith("mov") and held == SP:
            return 0  # back to what it was
        if mnemonic.startswith("mov") and isinstance(held, Rounded) and held.is_whole:
            return (1 << held.bits) - 1
        if not isinstance(held, int) or not mnemonic.startswith(("add", "sub")):
            sys.exit(f"{self.path}: {address:#x}: {mnemonic} {operands}: how much is that?")
        number = -held & 0xFFFFFFFF if mnemonic.startswith("add") else held
        return number if number < 1 << 31 else 0

    def note(self, mnemonic, operands, known):
        """What an instruction leaves in the register that it writes."""
        target, _, rest = operands.partition(", ")
        old = known.pop(target, None)
        if literal := re.match(r"^\[pc, .*\(([0-9a-f]+) ", rest):
            known[target] = self.words.get(int(literal[1], 16))
        elif match := re.match(r"^#(\d+)", rest):
            number = int(match[1])
            if re.match(r"^mov[ws]?(\.w)?$", mnemonic):
                known[target] = number
            elif mnemonic.startswith("movt") and isinstance(old, int):
                known[target] = number << 16 | old & 0xFFFF
            elif mnemonic.startswith("subs") and old == SP:
                known[target] = SP
        elif match := re.match(r"^(\w+), #(\d+)", rest):
            source = old if match[1] == target else known.get(match[1])
            if mnemonic.startswith("lsl") and isinstance(source, int):
                known[target] = source << int(match[2]) & 0xFFFFFFFF
            elif mnemonic.startswith("lsl") and source == Rounded(int(match[2]), False):
                known[target] = Rounded(int(match[2]), True)
            elif mnemonic.startswith("lsr") and source == SP:
                known[target] = Rounded(int(match[2]), False)
            elif mnemonic.startswith("add") and match[1] == "sp" or mnemonic.startswith("sub") and source == SP:
                known[target] = SP
        elif rest == "sp" and mnemonic.startswith("mov"):
            known[target] = SP

    def addresses_taken(self):
        """Functions whose address is a word of the image, or is put together by movw and movt; the vector table does not count."""
        low = min(address for address in self.words)
        vectors = {low + 4 * n for n in range(HANDLERS)} if self.is_vector(low) else set()
        # An instruction may read as an address: `strd r0, r0, [r5]` is 0xe9c5.
        instructions = {address for address, _, mnemonic, _ in self.code if not mnemonic.startswith(".")}
        others = vectors | instructions
        found = {word - 1 for address, word in self.words.items() if word & 1 and address not in others}
        halves = {}
        for _, function, mnemonic, operands in self.code:
            if match := re.match(r"^(\w+), #(\d+)", operands):
                if mnemonic.startswith("movw"):
                    halves[function, match[1]] = int(match[2])
                elif mnemonic.startswith("movt") and (function, match[1]) in halves:
                    found.add((int(match[2]) << 16 | halves[function, match[1]]) - 1)
        # A number may be that of the first function in flash by chance. A reset empties the stack.
        return {start for start in found & set(self.starts) if self.names[start] != "Reset"}

    def handlers(self):
        """What the vector table names: called by the processor, whatever number of the image is the same as its address."""
        table = min(address for address in self.words if self.is_vector(address))
        return {self.words.get(table + 4 * number, 0) - 1 for number in range(HANDLERS)}

    def is_vector(self, address):
        return self.names.get(self.words.get(address + 4, 0) - 1) == "Reset"

    def callees(self):
        """For each function those that it may call. Tasks are polled by the executor and by nobody else, and it calls nothing else by a pointer."""
        calls = {start: set() for start in self.starts}
        by_name = {name: start for start, name in self.names.items()}
        for start, name in self.names.items():
            # A veneer of the linker goes on by a `pop` into the program counter.
            if (thunk := THUNK.match(name)) and thunk[1] in by_name:
                calls[start].add(by_name[thunk[1]])
        tasks = {start for start in self.taken if POLL.search(self.names[start])}
        # The one of them that calls by a pointer: around embassy's is one of ours.
        executors = {site.function for site in self.sites if site.target is None and EXECUTOR.search(self.names[site.function])}
        # A boot loader has neither.
        if (len(executors), len(tasks)) != (0, 0) and (len(executors) != 1 or not tasks):
            sys.exit(f"{self.path}: {len(executors)} executors, {len(tasks)} tasks: have they other names now?")
        for site in self.sites:
            if site.target is not None:
                calls[site.function].add(site.target)
            elif EXECUTOR.search(self.names[site.function]):
                calls[site.function] |= tasks
            else:
                calls[site.function] |= self.taken - tasks
        return calls


def registers(operands):
    """How many registers a list in braces names."""
    count = 0
    for each in re.search(r"\{(.*)\}", operands)[1].split(", "):
        first, _, last = each.partition("-")
        count += int(last[1:]) - int(first[1:]) + 1 if last else 1
    return count


def groups(calls):
    """Strongly connected groups of functions, callees first (Tarjan, without recursion)."""
    order, low, stack, on_stack, done = {}, {}, [], set(), []
    for root in calls:
        work = [] if root in order else [(root, iter(calls[root]))]
        while work:
            node, rest = work[-1]
            if node not in order:
                order[node] = low[node] = len(order)
                stack.append(node)
                on_stack.add(node)
            for callee in rest:
                if callee not in order:
                    work.append((callee, iter(calls[callee])))
                    break
                if callee in on_stack:
                    low[node] = min(low[node], order[callee])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[node])
                if low[node] == order[node]:
                    group = set()
                    while node not in group:
                        group.add(stack.pop())
                    on_stack -= group
                    done.append(group)
    return done


def depths(image, deliberate=NOTHING):
    """Deepest stack of each function with all that it calls; `deliberate` are names of functions that are there to call each other in a circle."""
    calls, depth = image.callees(), {}
    refuse_recursion(image)
    refuse_recursion_by_pointers(image, calls, deliberate)
    for group in groups(calls):
        circle = len(group) > 1 or any(each in calls[each] for each in group)
        panics = any(UNWIND in image.names[each] for each in group)
        twice = {each for each in group if circle and (panics or FORMATS.search(image.plain[each]))}
        own = sum(image.frame[each] * (2 if each in twice else 1) for each in group)
        below = max((depth[callee] for each in group for callee in calls[each] if callee not in group), default=0)
        depth.update(dict.fromkeys(group, own + below))
    return depth


def refuse_recursion(image):
    """Functions that call each other in a circle, without any pointer, could do so for ever."""
    calls = {start: set() for start in image.starts}
    for site in image.sites:
        if site.target is not None:
            calls[site.function].add(site.target)
    for group in groups(calls):
        names = sorted(image.names[each] for each in group)
        circle = len(group) > 1 or group & calls[min(group)]
        # The panic handler may panic, once: then it stops without a word (firmware/src/panic.rs).
        if circle and not any(UNWIND in name for name in names) and not all(FORMATS.search(image.plain[each]) for each in group):
            sys.exit(f"{image.path}: these functions call each other in a circle: {', '.join(names)}")


def refuse_recursion_by_pointers(image, calls, deliberate):
    """Functions that are called by a pointer and lead to such a call could call themselves for ever; formatting does so as deep as its arguments are nested."""
    handlers = image.handlers()
    for group in groups(calls):
        if len(group) == 1 and not group & calls[min(group)]:
            continue
        suspects = (group & image.taken) - handlers
        known = lambda name: any(pattern.search(name) for pattern in (FORMATS, RETURNS, deliberate))
        names = sorted(name for each in suspects if not known(name := image.plain[each]))
        if names:
            sys.exit(f"{image.path}: these functions may call each other in a circle, by pointers: {', '.join(names)}")


def symbol(path, name):
    match = re.search(rf"^([0-9a-f]+) \S {name}$", tool("nm", path, text=True), re.M)
    return int(match[1], 16) if match else sys.exit(f"{path} has no symbol {name}")


class Bound(collections.namedtuple("Bound", "thread interrupt nmi entry fault")):
    """Bytes of stack at most: the program and its tasks; on top an interrupt, an NMI, and what a fault stacks; a fault's handler, on a stack of its own."""

    @property
    def total(self):
        return self.thread + self.interrupt + self.nmi + self.entry


def deepest(image, depth):
    """The deepest path from the reset on, as (frame, function); it ends where functions call each other in a circle."""
    calls, path = image.callees(), []
    callees = [start for start, name in image.names.items() if name == "Reset"]
    while callees and (start := max(callees, key=depth.get)) not in path:
        path.append(start)
        callees = calls[start]
    names = tool("c++filt", input="\n".join(image.names[start] for start in path), text=True).splitlines()
    return [(image.frame[start], name) for start, name in zip(path, names)]


def bound(path, deliberate=NOTHING):
    image = Stacks(path)
    return bound_of(path, image, depths(image, deliberate))


def bound_of(path, image, depth):
    by_name = {name: start for start, name in image.names.items()}
    table = min(address for address in image.words if image.is_vector(address))
    handler = lambda number: image.words.get(table + 4 * number, 0) - 1
    others = {handler(number) for number in range(4, HANDLERS)} & set(image.starts) - {by_name["Reset"]}
    core = "v6" if "v6S-M" in tool("readelf", "-A", path, text=True) else "v7e"
    has_rom = any("10embassy_rp" in name for name in by_name)
    thread = depth[by_name["Reset"]] + (ROM_BYTES if has_rom else 0)
    entry = EXCEPTION[core]
    return Bound(thread, entry + max(depth[each] for each in others), entry + depth[handler(NMI)], entry, depth[handler(FAULT)])


def check(path, budget):
    image = Stacks(path)
    depth = depths(image)
    found, room = bound_of(path, image, depth), symbol(path, "_stack_start") - symbol(path, "_stack_end")
    name = path.rsplit("/", 1)[-1]
    columns = (found.thread, found.interrupt, found.nmi, found.entry, found.total, found.fault, budget, room)
    print(f"| {name} | " + " | ".join(f"{each:,}" for each in columns) + " |", flush=True)
    fits = max(found.total, found.fault) <= min(budget, room)
    if not fits:
        print("Its deepest path, and what each function takes of it:")
        print("\n".join(f"{frame:7,}  {name}" for frame, name in deepest(image, depth)))
    return fits


def self_check():
    """A function that calls itself through another, and one that takes 1,000 bytes, are seen."""
    calls = {1: {2}, 2: {3, 4}, 3: {2}, 4: set()}
    assert sorted(map(sorted, groups(calls))) == [[1], [2, 3], [4]], groups(calls)
    assert function_ends("08013754 00000052 t grow\n080192d6 T ADC\n") == {0x8013754: 0x80137a6}
    assert [registers(each) for each in ("{r4, r7, lr}", "{d8-d11}", "sp!, {r4-r8, lr}")] == [3, 4, 6]
    image = Stacks.__new__(Stacks)
    image.words, image.path = {0x100: -1000 & 0xFFFFFFFF}, "self-check"
    code = [("push", "{r4, lr}", 8), ("sub", "sp, #24", 24), ("sub.w", "sp, sp, #1000", 1000), ("vpush", "{d8-d9}", 16),
            ("str.w", "r4, [sp, #-4]!", 4), ("add", "sp, #24", 0), ("add", "r7, sp, #8", 0), ("ldmia.w", "sp!, {r4, pc}", 0),
            ("ldr", "r6, [pc, #8]\t@ (100 <f+0x8>)", 0), ("add", "sp, r6", 1000), ("mov", "sp, r7", 0),
            ("movw", "ip, #34464", 0), ("movt", "ip, #1", 0), ("sub.w", "sp, sp, ip", 100000),
            ("movs", "r6, #128", 0), ("lsls", "r6, r6, #5", 0), ("sub", "sp, r6", 4096)]
    known = {}
    for mnemonic, operands, expected in code:
        taken = image.taken_by(0, mnemonic, operands, known)
        assert taken == expected, (mnemonic, operands, taken)
    aligned, known = [("mov", "r4, sp", 0), ("lsrs", "r4, r4, #5", 0), ("lsls", "r4, r4, #5", 0), ("mov", "sp, r4", 31)], {}
    assert [image.taken_by(0, *each[:2], known) for each in aligned] == [each[2] for each in aligned]
    for dynamic in ([("movs", "r0, #4"), ("add", "r0, r1"), ("sub.w", "sp, sp, r0")],
                    [("sub.w", "r4, sp, #64"), ("bfc", "r4, #0, #4"), ("mov", "sp, r4")],
                    [("mov", "r4, sp"), ("lsrs", "r4, r4, #5"), ("mov", "sp, r4")],
                    [("mov", "r4, sp"), ("lsrs", "r4, r4, #4"), ("lsls", "r4, r4, #5"), ("mov", "sp, r4")]):
        known = {}
        try:
            for mnemonic, operands in dynamic:
                image.taken_by(0, mnemonic, operands, known)
        except SystemExit:
            continue
        raise AssertionError(f"not refused: {dynamic}")


if __name__ == "__main__":
    self_check()
    images = [argument.rsplit("=", 1) for argument in sys.argv[1:]]
    print("| image | program and tasks | interrupt | NMI | fault's frame | together, bytes | fault | budget | room |")
    print("|---|" + "---:|" * 8)
    sys.exit(0 if all([check(path, int(budget)) for path, budget in images]) else "the stack is over its budget")
