"""Reads run.mcap with the mcap library, and compares every message of nodes with trajectory.csv, number by number.

Usage: recording.py run.mcap trajectory.csv [--torn]

Prints what it has seen as one line of JSON; ends with code 1 at the first difference. With --torn the file may end anywhere: it is read
from its begin on, without its index, as far as it goes.
"""

import csv
import json
import math
import sys
from collections import Counter
from decimal import Decimal

from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

FIELDS = ["x", "nu", "psi", "u", "true_nu", "asked_psi"]


def whole(file):
    """Topic and message of each message, in the order of their times; attachments and checksums are read, too."""
    reader = make_reader(file, validate_crcs=True)
    assert not isinstance(reader, NonSeekingReader)
    for _, channel, message in reader.iter_messages():
        yield channel.topic, message


def torn(file):
    """The same as far as a broken file goes."""
    topics, chunks = {}, StreamReader(file, emit_chunks=True, validate_crcs=True).records
    try:
        for chunk in chunks:
            for record in breakup_chunk(chunk, validate_crc=True) if isinstance(chunk, Chunk) else []:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                if isinstance(record, Message):
                    yield topics[record.channel_id], record
    except EndOfFile:
        return


def components(row, name, node):
    """Columns of a node as a number or a list; nothing where one is not known."""
    texts = [row[f"{name}_{node}"]] if f"{name}_{node}" in row else []
    while f"{name}_{node}_{len(texts)}" in row:
        texts.append(row[f"{name}_{node}_{len(texts)}"])
    numbers = [float(text) if text else math.nan for text in texts]
    if not all(map(math.isfinite, numbers)):
        return None
    return numbers if f"{name}_{node}" not in row else numbers[0]


def prediction(row, name):
    texts = [row[name]] if name in row else []
    while f"{name}_{len(texts)}" in row:
        texts.append(row[f"{name}_{len(texts)}"])
    if not all(texts):
        return None
    return float(texts[0]) if name in row else [float(text) for text in texts]


def main() -> None:
    path, trajectory, *options = sys.argv[1:]
    with open(trajectory, encoding="utf-8", newline="") as file:
        rows = {round(Decimal(row["t"]) * 10**9): row for row in csv.DictReader(file)}
    counts, events, names = Counter(), [], []
    with open(path, "rb") as file:
        for topic, message in (torn if "--torn" in options else whole)(file):
            said = json.loads(message.data)
            if topic == "/events":
                events.append([message.log_time, said["level"], said["name"], said["message"]])
                continue
            counts[topic] += 1
            row = rows[message.log_time]
            if topic == "/network":
                expected = {name: prediction(row, name) for name in ["xi", "blended"]}
            else:
                expected = {name: components(row, name, topic.removeprefix("/node/")) for name in FIELDS}
            expected = {name: value for name, value in expected.items() if value is not None}
            if said != expected:
                sys.exit(f"{topic} at {message.log_time} ns: {said}, and trajectory.csv has {expected}")
        if "--torn" not in options:
            file.seek(0)
            reader = make_reader(file)
            names = [[attachment.name, attachment.data.decode()] for attachment in reader.iter_attachments()]
    print(json.dumps({"rows": len(rows), "counts": counts, "events": events, "attachments": names}))


if __name__ == "__main__":
    main()
