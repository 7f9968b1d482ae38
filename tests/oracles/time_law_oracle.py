"""Time-optimal timing by Python's toppra: a line {"speed": [7], "acceleration": [7], "pieces": [{"length", "start", "slope",
"bend"}]} on stdin for each path q(t) = start + t·slope + ½ t²·bend; for each the seconds from rest to rest on stdout."""
import json
import sys

import numpy as np
import toppra
from toppra.algorithm import TOPPRA
from toppra.constraint import DiscretizationType, JointAccelerationConstraint, JointVelocityConstraint
from toppra.interpolator import AbstractGeometricPath

# Grid points of each piece.
STEPS = 150


class Pieces(AbstractGeometricPath):
    def __init__(self, pieces):
        self.ends = np.cumsum([0.0] + [piece["length"] for piece in pieces])
        self.coefficients = [np.array([piece[name] for piece in pieces]) for name in ("start", "slope", "bend")]

    def __call__(self, positions, order=0):
        places = np.atleast_1d(positions)
        piece = np.clip(np.searchsorted(self.ends, places, side="right") - 1, 0, len(self.ends) - 2)
        t = (places - self.ends[piece])[:, None]
        start, slope, bend = (values[piece] for values in self.coefficients)
        value = [start + t * slope + 0.5 * t * t * bend, slope + t * bend, bend][order]
        return value[0] if np.isscalar(positions) else value

    @property
    def dof(self):
        return self.coefficients[0].shape[1]

    @property
    def path_interval(self):
        return np.array([self.ends[0], self.ends[-1]])

    @property
    def waypoints(self):
        return self.ends, self(self.ends)


def both_ways(limit):
    return np.array([[-value, value] for value in limit])


toppra.setup_logging("ERROR")
for line in sys.stdin:
    asked = json.loads(line)
    path = Pieces(asked["pieces"])
    limits = [
        JointVelocityConstraint(both_ways(asked["speed"])),
        JointAccelerationConstraint(both_ways(asked["acceleration"]), DiscretizationType.Interpolation),
    ]
    # Finer towards both ends of a piece: there it takes the limits of both pieces for a whole step.
    shares = 0.5 - 0.5 * np.cos(np.pi * np.arange(STEPS) / STEPS)
    grid = [a + (b - a) * shares for a, b in zip(path.ends, path.ends[1:])] + [path.ends[-1:]]
    parameterisation = TOPPRA(limits, path, gridpoints=np.concatenate(grid), parametrizer="ParametrizeConstAccel")
    print(parameterisation.compute_trajectory(0, 0).duration)
