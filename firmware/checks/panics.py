"""No code of these crates leads to a panic: a check of linked images. Run by ./ci.sh panics.

usage: panics.py ROOT CRATE,CRATE... DRIVING-CRATE,DRIVING-CRATE... DEPENDENCY=LIMIT IMAGE...

The images are disassembled into a call graph. A function can panic if it is part of core::panicking, or calls one that
can from a place that is not in the crates. A call of such a function from a place that is in the crates is a finding;
so is a call through a pointer, whose target the disassembly does not tell. A place is in the crates if the debug
information has a source file of theirs in its chain of inlined functions: what a dependency does when it is inlined
into them counts as theirs.

Two things are checked besides, since the compiler may merge the ends of two branches and then name no line:
a call without one is judged by the places that jump to it, and no image may hold the name of a source file of the crates,
which is what a panic in them would pass on as its location. Stack overflow is not a panic and not looked for.

Driving crates call drivers of flash and pins, which may panic. They are judged by their own lines: a finding is a call of
core::panicking from one of them, directly or by the language's library. Every `async fn` has a panic for the case that it is polled
after its end, which nobody does who awaits it: these calls are no findings, and may leave the name of its file in the image. Where such an
`async fn` ends, the debug information may still name the line of another crate that was inlined before.
In the same way the panics of the dependency's own lines are counted; more than LIMIT are too many.

A line of a driving crate that says `// May panic: reason` may do so, in it or in the line before. So may `main` before its tasks run: a board that
cannot begin has nothing else to do.
"""

import functools
import re
import sys

from image import PANIC, Image, section_bytes

# The logger of a binary panics where it is entered twice, which is a defect of the binary.
LOGGER = re.compile(r"^_defmt_(acquire|write|release|flush)$")


# What an `async fn` does that is polled after its end.
RESUMED = re.compile(r"panic_const_(async|coroutine|gen)\w*_resumed")


# Of the language's own library: whoever calls it is responsible.
LIBRARY = re.compile(r"^/rustc/|/library/(core|alloc)/|/compiler[_-]builtins")


# What allows a line of a driving crate to panic.
ALLOWED = re.compile(r"// May panic: \w")
MAIN = "__cortex_m_rt_main"


class Owners:
    """Whose code a place is: of the strict crates, of the driving ones, of the dependency, of the language's library, or of others."""

    def __init__(self, root, strict, driving, dependency):
        self.strict, self.driving = (tuple(f"{root}/{crate}/" for crate in crates) for crates in (strict, driving))
        self.dependency = f"/{dependency}-"

    def of(self, chain):
        # Without a line, a row of the table names the file of whatever was compiled before it.
        chain = [frame for frame in chain if frame[2] not in "?0"]
        if any(file.startswith(self.strict) for _, file, _ in chain):
            return "strict"
        file = next((file for _, file, _ in chain if not LIBRARY.search(file)), None)
        if file is None:
            return "library" if chain else "others"
        if file.startswith(self.driving):
            return "driving"
        return "dependency" if self.dependency in file else "others"

    def is_driving(self, file):
        return file.startswith(self.driving)

    def is_own(self, file):
        return file.startswith((*self.strict, *self.driving))


def reaching(start, sites):
    """The functions that lead to those of `start` by calls at these places."""
    reached, size = set(start), 0
    while size != len(reached):
        size = len(reached)
        reached |= {site.function for site in sites if site.target in reached}
    return reached


def findings(image, owners):
    """Calls from the crates that can end in a panic, how many calls are theirs at all, and such calls of the dependency."""
    of = {site: {owners.of(chain) for chain in image.places(site)} for site in image.sites}
    panics = {start for start, name in image.names.items() if PANIC.search(name)}
    if not any(site.target in panics for site in image.sites):
        sys.exit(f"{image.path}: no call of a panic at all: the check does not understand this image")
    loggers = {start for start, name in image.names.items() if LOGGER.match(name)}
    by_anyone = reaching(panics, [site for site in image.sites if "strict" not in of[site] and site.function not in loggers])
    resumed = {start for start, name in image.names.items() if RESUMED.search(name)}
    by_library = reaching(panics - resumed, [site for site in image.sites if of[site] == {"library"} and site.function not in resumed])
    strict, driving, foreign = ([site for site in image.sites if who in of[site]] for who in ("strict", "driving", "dependency"))
    bad = [site for site in strict if site.target is None or site.target in by_anyone - resumed]
    bad += [site for site in driving if site.target in by_library and not is_allowed(image, site, owners)]
    return bad, len(strict) + len(driving), [site for site in foreign if site.target in by_library]


def is_allowed(image, site, owners):
    """Whether each place of a call is in a line that may panic."""
    own = [next((frame for frame in chain if owners.is_driving(frame[1])), None) for chain in image.places(site)]
    return all(frame is None or MAIN in frame[0] or is_marked(frame[1], frame[2]) for frame in own)


@functools.cache
def is_marked(path, line):
    number = int(line) if line.isdecimal() else 0
    with open(path, encoding="utf-8") as file:
        lines = file.read().splitlines()
    return any(ALLOWED.search(line) for line in lines[max(number - 2, 0):number])


def describe(image, site, is_own):
    chains = [chain for chain in image.places(site) if any(is_own(file) for _, file, _ in chain)]
    own = next(frame for frame in chains[0] if is_own(frame[1]))
    target = "a pointer" if site.target is None else image.names[site.target]
    inner = "" if chains[0][0] == own else f", there {chains[0][0][1]}:{chains[0][0][2]}"
    return f"{own[1]}:{own[2]}: {own[0]}{inner}: calls {target} at {site.address:#x}"


def location_names(path, root, crates):
    """Names of source files of the crates among the constants of an image, but those of `async fn`s."""
    names = set()
    for section in [".rodata", ".data", ".text"]:
        dump = section_bytes(path, section)
        for crate in crates:
            prefixes = (root.encode() + b"/" + crate.encode(), b"\\.\\./" + crate.encode())
            found = {each.decode() for prefix in prefixes for each in re.findall(prefix + rb"/src/[\w/]+\.rs", dump)}
            names |= {name.removeprefix(root + "/").removeprefix("../") for name in found}
    return sorted(name for name in names if not has_async_fn(f"{root}/{name}"))


def has_async_fn(path):
    with open(path, encoding="utf-8") as file:
        return "async fn" in file.read()


def check(path, root, crates, owners, dependency, limit):
    image = Image(path)
    bad, own, foreign = findings(image, owners)
    if own == 0:
        sys.exit(f"{path}: no call from {', '.join(crates)}: no debug information, or other paths")
    lines = [describe(image, site, owners.is_own) for site in bad]
    lines += [f"{name}: is the location of a panic" for name in location_names(path, root, crates)]
    if len(foreign) > limit:
        lines.append(f"{dependency}: {len(foreign)} of its calls can end in a panic, more than {limit}")
    for line in sorted(lines):
        print(line.replace(root + "/", ""), file=sys.stderr)
    print(f"{path.rsplit('/', 1)[-1]}: {len(bad)} of {own} calls from {', '.join(crates)} can end in a panic; {len(foreign)} of {dependency}")
    return not lines


if __name__ == "__main__":
    root, strict, driving, bound, *images = sys.argv[1:]
    strict, driving = strict.split(","), driving.split(",")
    dependency, limit = bound.split("=")
    arguments = (root, [*strict, *driving], Owners(root, strict, driving, dependency), dependency, int(limit))
    sys.exit(0 if all([check(path, *arguments) for path in images]) else 1)
