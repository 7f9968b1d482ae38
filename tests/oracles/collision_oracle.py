"""Collisions by FCL: a line with a cell (see fcl_cell.py) on stdin, then a way a line, a list of configurations; straight
between them, samples at most the angle of the first argument, degrees, apart on every axis. On stdout a line with the pairs of
links that overlap however the arm stands and are left out, then for each way a line
{"samples", "contacts": [{"pair", "at"}, ...] up to ten, "touching": samples in contact, "own", "others"}, the smallest distance
between two bodies of the arm and between any other two, each [mm, names] if below the second argument, else null; the
distance may be up to 0.5 mm less, a contact is a contact."""
import json
import sys

import numpy as np

from fcl_cell import read_cell

# What the smallest distance may be too large by: distances are not measured for less.
GOOD_TO_MM = 0.5

step, widest = np.radians(float(sys.argv[1])), float(sys.argv[2])
cell = read_cell(sys.stdin.readline())
print(json.dumps(cell.left_out), flush=True)


def sampled(way):
    samples = [way[:1]]
    for start, end in zip(way, way[1:]):
        pieces = max(1, int(np.ceil(np.abs(end - start).max() / step)))
        samples.append(start + (np.arange(1, pieces + 1) / pieces)[:, None] * (end - start))
    return np.concatenate(samples)


def seen(pair, placed, hits):
    """The corners of one body's box in the frame of the other, at the samples asked for."""
    a, b = pair
    relative = np.linalg.inv(placed[b][hits]) @ placed[a][hits]
    return relative[:, :3, :3] @ cell.bodies[a].corners + relative[:, :3, 3, None]


for line in sys.stdin:
    way = sampled(np.array(json.loads(line)))
    placed = cell.place(way)
    contacts, touching = [], set()
    # Nearest so far, and which two: of the arm's own bodies, and of others.
    nearest = {True: (widest, None), False: (widest, None)}
    for pair, gaps in zip(cell.pairs, cell.gaps(placed)):
        a, b = pair
        own = all(cell.is_on_arm(body) for body in pair)
        hits = np.flatnonzero(gaps <= nearest[own][0])
        ways = seen(pair, placed, hits)
        # How far the two are apart at the sample measured last; since then no point of the one moved further against the
        # other than a corner of its box.
        known, then = 0.0, None
        for i, corners in zip(hits, ways):
            if gaps[i] == 0.0 and cell.touch(a, b, placed[a][i], placed[b][i]):
                touching.add(int(i))
                nearest[own] = 0.0, cell.names(pair)
                if len(contacts) < 10:
                    contacts.append({"pair": cell.names(pair), "at": way[i].tolist()})
            if nearest[own][0] == 0.0:
                continue
            if then is None or known - np.linalg.norm(corners - then, axis=0).max() < nearest[own][0] - GOOD_TO_MM:
                known, then = cell.distance(a, b, placed[a][i], placed[b][i]), corners
                if known < nearest[own][0]:
                    nearest[own] = max(known, 0.0), cell.names(pair)
    said = {name: nearest[own] if nearest[own][1] else None for name, own in (("own", True), ("others", False))}
    print(json.dumps({"samples": len(way), "contacts": contacts, "touching": len(touching), **said}), flush=True)
