"""Writes CAN and CAN FD frames bit by bit, from the text of ISO 11898-1 (2015) and not from the Rust code: its judge.

Each line of standard input is a frame: identifier, extended, remote, FD, switch, passive, length, x and the data. Each line of standard output is
its bits from the start of frame to the end of the end of frame, n or s: nominal bits 0 and 1, bits at the faster rate _ and ^.
"""

import sys

LENGTHS = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]
# 10.4.2.6, generator polynomials without their highest term.
GENERATOR_15 = 0b100010110011001
GENERATOR_17 = 0b10110100001011011
GENERATOR_21 = 0b100000010100010011001
# Stuff count by number of stuff bits modulo 8: Gray code, parity.
STUFF_COUNT = ["0000", "0011", "0110", "0101", "1100", "1111", "1010", "1001"]


def number(value, width):
    return format(value, f"0{width}b")


def remainder(text, start, generator, width):
    register = start
    for bit in text:
        following = (int(bit) ^ (register >> (width - 1))) & 1
        register = (register << 1) & ((1 << width) - 1)
        if following:
            register ^= generator
    return number(register, width)


def stuff(text):
    """The text with stuff bits as letters, o for 0 and l for 1: one after five consecutive bits of the same value, stuff bits included."""
    out = ""
    for bit in text:
        out += bit
        tail = out[-5:].replace("o", "0").replace("l", "1")
        if tail in ("00000", "11111"):
            out += "l" if bit == "0" else "o"
    return out


def plain(stuffed):
    return stuffed.replace("o", "0").replace("l", "1")


def identifier(value, extended):
    if extended:
        return number(value >> 18, 11), number(value & 0x3FFFF, 18)
    return number(value, 11), ""


def classic(base, extension, remote, code, data):
    rtr = str(remote)
    if extension:
        start = "0" + base + "1" + "1" + extension + rtr + "0" + "0"
    else:
        start = "0" + base + rtr + "0" + "0"
    covered = start + number(code, 4) + data
    return plain(stuff(covered + remainder(covered, 0, GENERATOR_15, 15))) + "1"


def fd(base, extension, switch, passive, code, data):
    start = "0" + base + ("11" + extension + "0" if extension else "00") + "1" + "0"
    rest = str(switch) + str(passive) + number(code, 4) + data
    stuffed = stuff(start + rest)
    # A bit that would be stuffed after the last bit is not: the first fixed stuff bit follows.
    if stuffed[-1] in "ol":
        stuffed = stuffed[:-1]
    dynamic = stuffed.count("o") + stuffed.count("l")
    count = STUFF_COUNT[dynamic % 8]
    long = len(data) > 16 * 8
    width, generator = (21, GENERATOR_21) if long else (17, GENERATOR_17)
    field = count + remainder(plain(stuffed) + count, 1 << (width - 1), generator, width)
    bits = plain(stuffed)
    for at, bit in enumerate(field):
        if at % 4 == 0:
            bits += "1" if bits[-1] == "0" else "0"
        bits += bit
    bits += "1"
    if not switch:
        return bits
    # The place of the bit that switches among the stuffed bits: after all bits of the start.
    place = at = 0
    while True:
        if stuffed[at] in "01":
            if place == len(start):
                break
            place += 1
        at += 1
    return bits[:at + 1] + bits[at + 1:].replace("0", "_").replace("1", "^")


def bits_of(line):
    fields = line.split()
    value = int(fields[0], 16)
    extended, remote, is_fd, switch, passive, length = (int(field) for field in fields[1:7])
    data = "".join(number(byte, 8) for byte in bytes.fromhex(fields[7][1:]))
    base, extension = identifier(value, extended)
    code = LENGTHS.index(length)
    if is_fd:
        frame = fd(base, extension, switch, passive, code, data)
    else:
        frame = classic(base, extension, remote, code, data)
    # Acknowledgement slot as the sender sends it, its delimiter, end of frame.
    return frame + "1" + "1" + 7 * "1"


for each in sys.stdin:
    print(bits_of(each))
