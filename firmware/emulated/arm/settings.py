"""How much is tried: what CI has time for, or everything (FUNNEL_EXTENDED=1)."""

import os

EXTENDED = os.environ.get("FUNNEL_EXTENDED") == "1"


def cut_every(operations):
    """A power cut at every so-manyth flash operation, or at each of them."""
    return 1 if EXTENDED else operations


def jitter_ticks():
    """How many ticks a node runs by its own clock while their jitter is measured."""
    return 10_000 if EXTENDED else 300


def noise_bytes():
    """How many bytes of noise come on a line."""
    return 60_000 if EXTENDED else 5_000
