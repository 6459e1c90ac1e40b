"""A UF2 file out of the ELF file of an image, for boards that take it by drag and drop. The format: https://github.com/microsoft/uf2

usage: uf2.py IMAGE [ELF OUT]      IMAGE: its name in Cargo.toml, which says for what chip it is; alone, it is only looked up
"""

import collections
import pathlib
import struct
import sys

import boards

PAYLOAD = 256
HAS_FAMILY = 0x2000
BEGIN, BEGIN_2, END = 0x0A324655, 0x9E5D5157, 0x0AB16F30
BLOCK = "<8I476sI"
ERASED = 0xFF
ARM, LOADED = 40, 1

Segment = collections.namedtuple("Segment", "address data")


def board_of(facts, name):
    """The board of an image; a refusal where its chip takes no UF2, or where the image is only a part of what the flash needs."""
    found = {image["name"]: image["board"] for image in facts.images}
    by_name = {board["name"]: board for board in facts.boards}
    parts = [image["name"] for image in facts.images if image.get("features") in boards.PARTS]
    takers = [image for image, board in found.items() if "uf2" in by_name[board] and image not in parts]
    if name not in found:
        sys.exit(f"image is {name}, which there is not; images that become a UF2 file: {', '.join(takers)}")
    board = by_name[found[name]]
    if "uf2" not in board:
        chip = board.get("chip", board["core"])
        sys.exit(f"image {name} is for {chip}, which takes no UF2 file; images that become one: {', '.join(takers)}")
    if name in parts:
        sys.exit(f"image {name} is one of two that a board with updates needs, and does nothing alone (book: update); images that become a UF2 file: {', '.join(takers)}")
    return board


def segments(elf):
    """What is flashed, by the address that it is flashed to (ELF32, little endian)."""
    if elf[:6] != b"\x7fELF\x01\x01":
        sys.exit("the image is no ELF file of 32 bits for ARM")
    if len(elf) < 52:
        sys.exit("the image is cut off: an ELF file has a header of 52 bytes")
    if struct.unpack_from("<H", elf, 18) != (ARM,):
        sys.exit("the image is no ELF file of 32 bits for ARM")
    (start,), (size, count) = struct.unpack_from("<I", elf, 28), struct.unpack_from("<2H", elf, 42)
    if count == 0 or start + count * size > len(elf):
        sys.exit("the image has no segments, or is cut off before them")
    for header in range(start, start + count * size, size):
        kind, offset, _, address, length = struct.unpack_from("<5I", elf, header)
        if kind == LOADED and length > 0:
            if offset + length > len(elf):
                sys.exit(f"the image is cut off: its segment at {address:#x} ends at byte {offset + length} of {len(elf)}")
            yield Segment(address, elf[offset:offset + length])


def pages(loaded, board):
    """Whole sectors of flash in pages: the RP2040's boot ROM drops parts of a sector that is not complete (data sheet, RP2040-E14)."""
    sector, (flash, size), boot2 = board["sector"], board["flash"], board.get("boot2", 0)
    storage, room = board.get("storage", (0, 0))
    sectors = {}
    for address, data in loaded:
        if not flash - boot2 <= address <= address + len(data) <= flash + size:
            sys.exit(f"a segment is at {address:#x} to {address + len(data):#x}, not in flash, {flash - boot2:#x} to {flash + size:#x}")
        for at, byte in enumerate(data, address):
            sectors.setdefault(at // sector, bytearray([ERASED]) * sector)[at % sector] = byte
    for number, content in sorted(sectors.items()):
        if storage - sector < number * sector < storage + room:
            sys.exit(f"the sector at {number * sector:#x} is in the storage, {storage:#x} to {storage + room:#x}: the stored configuration would be lost")
        for offset in range(0, sector, PAYLOAD):
            yield Segment(number * sector + offset, bytes(content[offset:offset + PAYLOAD]))


def uf2(elf, board):
    """The file."""
    blocks = list(pages(segments(elf), board))
    if not blocks:
        sys.exit("the image has nothing that is flashed")
    pack = struct.Struct(BLOCK).pack
    head = (BEGIN, BEGIN_2, HAS_FAMILY)
    return b"".join(pack(*head, address, PAYLOAD, number, len(blocks), board["uf2"], data, END) for number, (address, data) in enumerate(blocks))


def main(name, elf=None, out=None):
    board = board_of(boards.Boards(boards.metadata()), name)
    if elf:
        pathlib.Path(out).write_bytes(uf2(pathlib.Path(elf).read_bytes(), board))


if __name__ == "__main__":
    if len(sys.argv) not in (2, 4):
        sys.exit(__doc__)
    main(*sys.argv[1:])
