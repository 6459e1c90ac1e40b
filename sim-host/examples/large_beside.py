"""The law of large networks in NumPy with scipy.sparse, and in Numba, beside `sim-host`'s own, in one run.

Usage: large_beside.py COMMAND [NODES [TICKS]], where COMMAND is the built example `large_ticks`; needs numpy, scipy and numba.

The same law in float32 on a random 4-regular graph: node-wise, reciprocal gain of scale 1, one exponential funnel, affine fields. Prints
node-steps per second on one core, and the largest and lowest state as a check that they compute the same law.

The graphs are each program's own: `large_ticks` draws one from its seed, and NumPy and Numba share another. So the states are alike, and not
the same. Other work on the machine shows in the figures.
"""

import os
import subprocess
import sys
import time

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

# They read the number of threads when they are imported.
import numba  # noqa: E402
import numpy as np  # noqa: E402
import scipy.sparse  # noqa: E402

T = np.float32(1e-3)
G = np.float32(0.1)
B = np.float32(0.5 * 2.2 * 1e-3 * 4)


def graph(nodes, rng):
    """Neighbours of each node: two random Hamilton cycles, drawn again while they share an edge."""
    neighbours = np.empty((nodes, 4), np.int32)
    while True:
        for half in (0, 2):
            order = rng.permutation(nodes)
            neighbours[order, half] = np.roll(order, 1)
            neighbours[order, half + 1] = np.roll(order, -1)
        ordered = np.sort(neighbours, axis=1)
        same = np.nonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))[0]
        # A double edge counts twice here, which changes no time.
        if len(same) < 32:
            return neighbours


def widths(k):
    left = np.float32(38.0) * np.exp(np.float32(-1e-3 * k), dtype=np.float32)
    return np.float32(2.0) + left, np.float32(2.0) + left * np.float32(np.exp(-0.5e-3))


def solve(psi, r):
    rho = np.abs(r)
    excess = rho + B - psi
    root = np.sqrt(excess * excess + np.float32(4.0) * psi * B)
    gap = np.where(excess >= 0, np.float32(2.0) * B / (excess + root), (root - excess) / (np.float32(2.0) * psi))
    return r / (psi * gap + B)


def with_numpy(neighbours, x, slope, offset, ticks):
    """All nodes at once; the sums over neighbours by a sparse matrix."""
    nodes = len(x)
    rows = np.repeat(np.arange(nodes), 4)
    adjacency = scipy.sparse.csr_matrix((np.ones(4 * nodes, np.float32), (rows, neighbours.ravel())), (nodes, nodes))
    dx, carry, last, before, dnu_before = (np.zeros(nodes, np.float32) for _ in range(5))
    for k in range(ticks + 1):
        now, ahead = widths(k)
        both = adjacency @ np.stack([x, dx], axis=1)
        nu, dnu = both[:, 0] - np.float32(4.0) * x, both[:, 1] - np.float32(4.0) * dx
        if k == 0:
            last = solve(ahead, nu)
        r = nu + np.float32(0.5) * dnu + B * last
        if k > 1:
            r += G * ((dnu - dnu_before) + np.float32(2.0) * B * (last - before))
        u = solve(ahead, r)
        last, before, dnu_before = u, last, dnu
        middle = x + np.float32(0.5) * T * (slope * x + offset + u)
        change = T * (slope * middle + offset + u) - carry
        after = x + change
        carry = (after - x) - change
        dx, x = after - x, after
    return x


@numba.njit(fastmath=False)
def loop(neighbours, x, slope, offset, ticks, nows, aheads):
    nodes = len(x)
    dx = np.zeros(nodes, np.float32)
    carry, last, before, dnu_before = (np.zeros(nodes, np.float32), np.zeros(nodes, np.float32), np.zeros(nodes, np.float32), np.zeros(nodes, np.float32))
    x_next, dx_next = np.zeros(nodes, np.float32), np.zeros(nodes, np.float32)
    half, two, four = np.float32(0.5), np.float32(2.0), np.float32(4.0)
    for k in range(ticks + 1):
        psi = aheads[k]
        for i in range(nodes):
            xi, dxi = x[i], dx[i]
            nu, dnu = np.float32(0.0), np.float32(0.0)
            for e in range(4):
                j = neighbours[i, e]
                nu += x[j] - xi
                dnu += dx[j] - dxi
            rounds = 2 if k == 0 else 1
            u = last[i]
            for turn in range(rounds):
                r = nu if (k == 0 and turn == 0) else nu + half * dnu + B * u
                if k > 1:
                    r += G * ((dnu - dnu_before[i]) + two * B * (u - before[i]))
                held = u
                excess = abs(r) + B - psi
                root = np.sqrt(excess * excess + four * psi * B)
                gap = two * B / (excess + root) if excess >= 0 else (root - excess) / (two * psi)
                u = r / (psi * gap + B)
            before[i], last[i], dnu_before[i] = held, u, dnu
            middle = xi + half * T * (slope[i] * xi + offset[i] + u)
            change = T * (slope[i] * middle + offset[i] + u) - carry[i]
            after = xi + change
            carry[i] = (after - xi) - change
            x_next[i], dx_next[i] = after, after - xi
        x, x_next = x_next, x
        dx, dx_next = dx_next, dx
    return x


def tell(name, nodes, ticks, run):
    begin = time.process_time()
    x = run()
    seconds = time.process_time() - begin
    print(f"{name}: {nodes * (ticks + 1) / seconds:.3e} node-steps per second, states {x.min():.6f} to {x.max():.6f}", flush=True)


def main():
    command = sys.argv[1]
    nodes = int(sys.argv[2]) if len(sys.argv) > 2 else 100_000
    ticks = int(sys.argv[3]) if len(sys.argv) > 3 else 300
    rng = np.random.default_rng(1)
    neighbours = graph(nodes, rng)
    x = rng.uniform(-2, 2, nodes).astype(np.float32)
    slope = rng.uniform(-1.5, -0.5, nodes).astype(np.float32)
    offset = rng.normal(0, 1, nodes).astype(np.float32)
    both = np.array([widths(k) for k in range(ticks + 1)], np.float32)
    nows, aheads = both[:, 0].copy(), both[:, 1].copy()
    loop(neighbours[:, :], x.copy(), slope, offset, 1, nows, aheads)
    tell("numpy and scipy.sparse", nodes, ticks, lambda: with_numpy(neighbours, x.copy(), slope, offset, ticks))
    tell("numba", nodes, ticks, lambda: loop(neighbours, x.copy(), slope, offset, ticks, nows, aheads))
    print(subprocess.run([command, str(nodes), str(ticks), "1"], check=True, capture_output=True, text=True).stdout, end="")


if __name__ == "__main__":
    main()
