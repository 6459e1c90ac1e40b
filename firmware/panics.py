"""No code of these crates leads to a panic: a check of linked images. Run by ./ci.sh panics.

usage: panics.py ROOT CRATE,CRATE... IMAGE...

The images are disassembled into a call graph. A function can panic if it is part of core::panicking, or calls one that
can from a place that is not in the crates. A call of such a function from a place that is in the crates is a finding;
so is a call through a pointer, whose target the disassembly does not tell. A place is in the crates if the debug
information has a source file of theirs in its chain of inlined functions: what a dependency does when it is inlined
into them counts as theirs.

Two things are checked besides, since the compiler may merge the ends of two branches and then name no line:
a call without one is judged by the places that jump to it, and no image may hold the name of a source file of the crates,
which is what a panic in them would pass on as its location. Stack overflow is not a panic and not looked for.
"""

import collections
import re
import subprocess
import sys

FUNCTION = re.compile(r"^([0-9a-f]+) <(.+)>:$")
INSTRUCTION = re.compile(r"^ *([0-9a-f]+):\t(\S+)(?:\t(.*))?$")
TARGET = re.compile(r"(?:^|, )([0-9a-f]+) <")
# Where every panic begins or ends, by mangled name.
PANIC = re.compile(r"4core9panicking|rust_begin_unwind")
BRANCH = re.compile(r"^(bl?x?(eq|ne|cs|cc|hs|lo|mi|pl|vs|vc|hi|ls|ge|lt|gt|le|al)?|cbn?z)(\.[nw])?$")
CALL = re.compile(r"^blx?(\.w)?$")
# The logger of a binary panics where it is entered twice, which is a defect of the binary.
LOGGER = re.compile(r"^_defmt_(acquire|write|release|flush)$")
LEAVES = re.compile(r"^(b|bx|udf)(\.[nw])?$")

Site = collections.namedtuple("Site", "address function target")  # target: a function, None through a pointer


def tool(name, *arguments, **options):
    return subprocess.run([f"arm-none-eabi-{name}", *arguments], check=True, capture_output=True, **options).stdout


class Image:
    """Functions, the calls between them, and the jumps within them."""

    def __init__(self, path):
        self.path = path
        self.starts, self.names, self.code = [], {}, []
        for line in tool("objdump", "-d", "--no-show-raw-insn", path, text=True).splitlines():
            if match := FUNCTION.match(line):
                self.starts.append(int(match[1], 16))
                self.names[self.starts[-1]] = match[2]
            elif match := INSTRUCTION.match(line):
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


def jump_target(mnemonic, operands):
    match = TARGET.search(operands) if BRANCH.match(mnemonic) else None
    return int(match[1], 16) if match else None


def findings(image, is_own):
    """Calls from the crates that can end in a panic, and how many calls are theirs at all."""
    own = {site for site in image.sites if any(is_own(file) for chain in image.places(site) for _, file, _ in chain)}
    can = {start for start, name in image.names.items() if PANIC.search(name)}
    if not any(site.target in can for site in image.sites):
        sys.exit(f"{image.path}: no call of a panic at all: the check does not understand this image")
    loggers = {start for start, name in image.names.items() if LOGGER.match(name)}
    size = 0
    while size != len(can):
        size = len(can)
        can |= {site.function for site in image.sites if site.target in can and site not in own}
        can -= loggers
    bad = [site for site in image.sites if site in own and (site.target is None or site.target in can)]
    return bad, len(own)


def describe(image, site, is_own):
    chains = [chain for chain in image.places(site) if any(is_own(file) for _, file, _ in chain)]
    own = next(frame for frame in chains[0] if is_own(frame[1]))
    target = "a pointer" if site.target is None else image.names[site.target]
    inner = "" if chains[0][0] == own else f", there {chains[0][0][1]}:{chains[0][0][2]}"
    return f"{own[1]}:{own[2]}: {own[0]}{inner}: calls {target} at {site.address:#x}"


def location_names(path, root, crates):
    """Names of source files of the crates among the constants of an image."""
    names = set()
    for section in [".rodata", ".data", ".text"]:
        dump = tool("objcopy", "-O", "binary", "-j", section, path, "/dev/stdout")
        for crate in crates:
            prefixes = (root.encode() + b"/" + crate.encode(), b"\\.\\./" + crate.encode())
            names |= {each.decode() for prefix in prefixes for each in re.findall(prefix + rb"/src/[\w/]+\.rs", dump)}
    return sorted(names)


def check(path, root, crates):
    prefixes = tuple(f"{root}/{crate}/" for crate in crates)
    is_own = lambda file: file.startswith(prefixes)
    image = Image(path)
    bad, own = findings(image, is_own)
    if own == 0:
        sys.exit(f"{path}: no call from {', '.join(prefixes)}: no debug information, or other paths")
    lines = [describe(image, site, is_own) for site in bad]
    lines += [f"{name}: is the location of a panic" for name in location_names(path, root, crates)]
    for line in sorted(lines):
        print(line.replace(root + "/", ""), file=sys.stderr)
    print(f"{path.rsplit('/', 1)[-1]}: {len(lines)} of {own} calls from {', '.join(crates)} can end in a panic")
    return not lines


if __name__ == "__main__":
    root, crates, images = sys.argv[1], sys.argv[2].split(","), sys.argv[3:]
    sys.exit(0 if all([check(path, root, crates) for path in images]) else 1)
