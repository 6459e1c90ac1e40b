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

import re
import sys

from image import PANIC, Image, tool

# The logger of a binary panics where it is entered twice, which is a defect of the binary.
LOGGER = re.compile(r"^_defmt_(acquire|write|release|flush)$")


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
