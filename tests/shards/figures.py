"""Prints a table of runs without the columns that depend on the machine."""

import csv
import sys

with open(sys.argv[1], newline="") as file:
    rows = list(csv.reader(file))
kept = [at for at, name in enumerate(rows[0]) if not name.startswith(("wall_", "cpu_"))]
csv.writer(sys.stdout).writerows([row[at] for at in kept] for row in rows)
