"""Decodes can.log by a DBC file with cantools, and compares every state with trajectory.csv, bit for bit.

Usage: dbc.py FILE.dbc can.log trajectory.csv TICK_NS

Prints what it has seen as one line of JSON; ends with code 1 at the first difference, or at a frame that the DBC file does not know.
trajectory.csv has a row for each tick (--every TICK).
"""

import csv
import json
import struct
import sys
from collections import Counter
from decimal import Decimal

import cantools


def frames(log: str):
    """Time in ns, identifier and data of each frame with an 11-bit identifier, and whether it has the format of CAN FD."""
    with open(log, encoding="ascii") as lines:
        for line in lines:
            time, _, frame = line.split()[:3]
            name, data = frame.split("#", 1)
            is_fd = data.startswith("#")
            data = data[2:] if is_fd else data
            if len(name) == 3:
                yield int(Decimal(time.strip("()")) * 10**9), int(name, 16), bytes.fromhex(data), is_fd


def bits(number: float) -> bytes:
    return struct.pack("<f", number)


def nearest(low: int, size: int, around: int) -> int:
    """The number with these low bits that is nearest to `around`."""
    return around + (low - around + size // 2) % size - size // 2


def main() -> None:
    dbc, log, trajectory, tick_ns = sys.argv[1:]
    database = cantools.database.load_file(dbc)
    with open(trajectory, encoding="utf-8", newline="") as file:
        rows = {round(Decimal(row["t"]) * 10**9 / Decimal(tick_ns)): row for row in csv.DictReader(file)}
    kinds, compared, before, edges, units = Counter(), 0, 0, {}, set()
    for time, number, data, is_fd in frames(log):
        message = database.get_message_by_frame_id(number)
        if message.length != len(data) or message.is_fd != is_fd:
            sys.exit(f"{message.name}: {len(data)} bytes, FD {is_fd}; the DBC file says {message.length}, FD {message.is_fd}")
        # Strict: no signal ends beyond the data.
        said = message.decode(data, decode_choices=False)
        kind = message.name.split("_")[0]
        kinds[kind] += 1
        if kind == "EDGE":
            edges[f"{message.senders[0]}-{said['other']}"] = said["alpha"]
        if kind != "STATE":
            continue
        size = 1 << message.get_signal_by_name("tick").length
        tick = nearest(said["tick"], size, time // int(tick_ns))
        for signal in message.signals:
            if not signal.name.startswith("x_"):
                continue
            units.add(signal.unit)
            if tick < 0:
                before += 1
                continue
            wanted = float(rows[tick][signal.name])
            if bits(wanted) != bits(said[signal.name]):
                sys.exit(f"tick {tick}, {signal.name}: {wanted!r} in the trajectory, {said[signal.name]!r} by the DBC file")
            compared += 1
    told = {"compared": compared, "before": before, "kinds": kinds, "edges": edges, "units": sorted(unit or "" for unit in units)}
    print(json.dumps(told, sort_keys=True))


main()
