"""The code of a linked image: functions, calls, and jumps, from its disassembly."""

import collections
import math
import pathlib
import re
import subprocess
import tempfile

FUNCTION = re.compile(r"^([0-9a-f]+) <(.+)>:$")
INSTRUCTION = re.compile(r"^ *([0-9a-f]+):\t(\S+)(?:\t(.*))?$")
TARGET = re.compile(r"(?:^|, )([0-9a-f]+) <")
# Where every panic begins or ends, by mangled name.
PANIC = re.compile(r"4core9panicking|rust_begin_unwind")
BRANCH = re.compile(r"^(bl?x?(eq|ne|cs|cc|hs|lo|mi|pl|vs|vc|hi|ls|ge|lt|gt|le|al)?|cbn?z)(\.[nw])?$")
CALL = re.compile(r"^blx?(\.w)?$")
LEAVES = re.compile(r"^(b|bx|udf)(\.[nw])?$")

Site = collections.namedtuple("Site", "address function target")  # target: a function, None through a pointer


def tool(name, *arguments, **options):
    return subprocess.run([f"arm-none-eabi-{name}", *arguments], check=True, capture_output=True, **options).stdout


def section_bytes(path, section):
    """What is in a section. By a file: where objcopy fails it removes its output, and that must not be /dev/stdout."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "bytes"
        tool("objcopy", "-O", "binary", "-j", section, path, str(out))
        return out.read_bytes() if out.exists() else b""


class Image:
    """Functions, the calls between them, and the jumps within them."""

    def __init__(self, path):
        self.path = path
        self.starts, self.names, self.code = [], {}, []
        ends = function_ends(tool("nm", "-S", path, text=True))
        for line in tool("objdump", "-d", "--no-show-raw-insn", path, text=True).splitlines():
            if match := FUNCTION.match(line):
                self.starts.append(int(match[1], 16))
                self.names[self.starts[-1]] = match[2]
            # What lld fills gaps with (0xd4d4) would be read as a jump into a neighbour.
            elif (match := INSTRUCTION.match(line)) and int(match[1], 16) < ends.get(self.starts[-1], math.inf):
                self.code.append((int(match[1], 16), self.starts[-1], match[2], match[3] or ""))
        self.sites = [site for each in self.code if (site := self.site(*each))]
        self.frames = dict(self.lines([address for address, *_ in self.code]))

    def site(self, address, function, mnemonic, operands):
        """The call or tail call that an instruction is, if it is one."""
        target = jump_target(mnemonic, operands)
        if target is not None:
            callee = self.function_of(target)
            # Within a function `bl` is a long jump, where it does not go to its beginning (ARMv6-M).
            calls = callee != function or (CALL.match(mnemonic) and target == callee)
            return Site(address, function, callee) if calls else None
        # `mov pc` is how LLVM jumps by a table; it calls by blx, and leaves by bx.
        pointer = re.match(r"^bl?x", mnemonic) and operands != "lr"
        return Site(address, function, None) if pointer else None

    def function_of(self, address):
        low, high = 0, len(self.starts)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.starts[middle] <= address else (low, middle)
        return self.starts[low]

    def lines(self, addresses):
        """For every address the chain of inlined functions, innermost first, as (function, file, line)."""
        text = tool("addr2line", "-a", "-i", "-f", "-C", "-e", self.path,
                    input="\n".join(map(hex, addresses)), text=True).splitlines()
        heads = [index for index, line in enumerate(text) if re.match(r"^0x[0-9a-f]+$", line)]
        for head, end in zip(heads, heads[1:] + [len(text)]):
            pairs = zip(text[head + 1:end:2], text[head + 2:end:2])
            yield int(text[head], 16), [(name, *re.sub(r" \(.*", "", place).rsplit(":", 1)) for name, place in pairs]

    def places(self, site):
        """The chains of a call; where it has no line, also those of the instructions that lead to its block."""
        own = self.frames.get(site.address, [])
        if own and own[0][2] not in "?0":
            return [own]
        index = next(i for i, (address, *_) in enumerate(self.code) if address == site.address)
        first = index
        while first > 0 and self.code[first - 1][1] == site.function and not self.never_falls(first - 1):
            first -= 1
        low = self.code[first][0]
        jumps = [a for a, f, m, o in self.code if f == site.function and low <= (jump_target(m, o) or -1) <= site.address]
        block = [address for address, *_ in self.code[first:index]]
        if not jumps:
            # Reached by a table: from anywhere in the function.
            jumps = [address for address, function, *_ in self.code if function == site.function]
        return [self.frames.get(address, []) for address in [site.address, *block, *jumps]]

    def never_falls(self, index):
        _, _, mnemonic, operands = self.code[index]
        if LEAVES.match(mnemonic) or (mnemonic.startswith(("pop", "ldmia")) and "pc" in operands):
            return True
        target = jump_target(mnemonic, operands)
        return target is not None and bool(CALL.match(mnemonic)) and bool(PANIC.search(self.names[self.function_of(target)]))


def function_ends(symbols):
    """Where functions end whose size is known, by their beginnings; `symbols` is what `nm -S` prints."""
    found = re.findall(r"^([0-9a-f]+) ([0-9a-f]+) [tTwW] ", symbols, re.M)
    return {int(start, 16): int(start, 16) + int(size, 16) for start, size in found}


def jump_target(mnemonic, operands):
    match = TARGET.search(operands) if BRANCH.match(mnemonic) else None
    return int(match[1], 16) if match else None
