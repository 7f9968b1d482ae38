"""Collisions by FCL: a line with a cell (see fcl_cell.py) on stdin, then a way a line, a list of configurations; straight
between them, samples at most the angle of the first argument, degrees, apart on every axis. On stdout a line with the pairs of
links that overlap however the arm stands and are left out, then for each way a line
{"samples", "contacts": [{"pair", "at"}, ...] up to ten, "touching": samples in contact, "smallest_mm", "between"}, the smallest
distance as far as it is below the second argument, mm, else null."""
import json
import sys

import numpy as np

from fcl_cell import read_cell

step, widest = np.radians(float(sys.argv[1])), float(sys.argv[2])
cell = read_cell(sys.stdin.readline())
print(json.dumps(cell.left_out), flush=True)


def sampled(way):
    samples = [way[:1]]
    for start, end in zip(way, way[1:]):
        pieces = max(1, int(np.ceil(np.abs(end - start).max() / step)))
        samples.append(start + (np.arange(1, pieces + 1) / pieces)[:, None] * (end - start))
    return np.concatenate(samples)


def corners(body, matrices):
    return matrices[:, :3, :3] @ body.corners + matrices[:, :3, 3, None]


for line in sys.stdin:
    way = sampled(np.array(json.loads(line)))
    placed = cell.place(way)
    paths = [corners(body, matrices) for body, matrices in zip(cell.bodies, placed)]
    contacts, touching = [], set()
    smallest, between = widest, None
    for pair, gaps in zip(cell.pairs, cell.gaps(placed)):
        a, b = pair
        # How far the two are apart at the sample measured last; since then no point of a body moved further than a corner
        # of its box.
        known, then = 0.0, None
        for i in np.flatnonzero(gaps <= smallest):
            if gaps[i] == 0.0 and cell.touch(a, b, placed[a][i], placed[b][i]):
                touching.add(int(i))
                smallest, between = 0.0, cell.names(pair)
                if len(contacts) < 10:
                    contacts.append({"pair": cell.names(pair), "at": way[i].tolist()})
                continue
            if smallest == 0.0:
                continue
            moved = 0.0
            if then is not None:
                moved = sum(np.linalg.norm(paths[body][i] - paths[body][then], axis=0).max() for body in pair)
            if then is None or known - moved < smallest:
                known, then = cell.distance(a, b, placed[a][i], placed[b][i]), i
                if known < smallest:
                    smallest, between = max(known, 0.0), cell.names(pair)
    answer = {"samples": len(way), "contacts": contacts, "touching": len(touching)}
    print(json.dumps({**answer, "smallest_mm": None if between is None else smallest, "between": between}), flush=True)
