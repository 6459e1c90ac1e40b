"""How much is tried: what CI has time for, or everything (FUNNEL_EXTENDED=1)."""

import os

EXTENDED = os.environ.get("FUNNEL_EXTENDED") == "1"


def cut_every(operations):
    """A power cut at every so-manyth flash operation, or at each of them."""
    return 1 if EXTENDED else operations


def flood_ms():
    """How long foreign frames come at line rate."""
    return 1000 if EXTENDED else 200


def noise_bytes():
    """How many bytes of noise come on a line."""
    return 60_000 if EXTENDED else 5_000
