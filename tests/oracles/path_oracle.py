"""Ways by OMPL's RRT-Connect: a line with a cell (see fcl_cell.py) on stdin, then a question a line, {"home", "goals", "low",
"high"}: a way from home to any of the goals within the limits, on which FCL finds no contact. For each a line on stdout: {"asked",
"solved", "checks", "seconds"}. Arguments: seconds a question, and seconds for all: what does not fit is not asked. A way counts
once it is free of contact every half degree of any axis, the shapes' surfaces tested triangle by triangle."""
import json
import math
import sys
import time

import fcl
import numpy as np
from ompl import base, geometric, util

from fcl_cell import read_cell

# Longest step between two states that OMPL tests on a segment, radians of the joint space's metric.
STEP_RAD = np.radians(1.0)
STEP_CONFIRMED_RAD = np.radians(0.5)
AXES = 7

util.noOutputHandler()


def turn(axis, angle):
    """Rotation about a unit axis (Rodrigues)."""
    (x, y, z), sin, cos = axis, math.sin(angle), math.cos(angle)
    rest = 1.0 - cos
    return np.array(
        [
            [cos + x * x * rest, x * y * rest - z * sin, x * z * rest + y * sin, 0.0],
            [y * x * rest + z * sin, cos + y * y * rest, y * z * rest - x * sin, 0.0],
            [z * x * rest - y * sin, z * y * rest + x * sin, cos + z * z * rest, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


class Checker:
    """One state at a time."""

    def __init__(self, cell):
        self.cell = cell
        self.objects = [fcl.CollisionObject(body.solid, fcl.Transform()) for body in cell.bodies]
        self.first, self.second = np.array(cell.pairs).T
        self.centres = np.array([body.centre for body in cell.bodies])
        self.halves = np.array([body.half for body in cell.bodies])
        # Seven frames, of the foot and behind each joint, then the table, and where in them each body's owner is.
        arm, zero = cell.arm, np.zeros((1, 6))
        frames = [np.eye(4), *(arm.base_from(joint.find("child").get("link"), zero)[0] for joint in arm.moving)]
        self.steps = [np.linalg.inv(before) @ frame for before, frame in zip(frames, frames[1:])]
        axes = [np.array([float(v) for v in joint.find("axis").get("xyz").split()]) for joint in arm.moving]
        self.axes = [axis / np.linalg.norm(axis) for axis in axes]
        self.frame_of, self.frame_from_owner = [], []
        for body, owner in zip(cell.bodies, cell.owner_from_body):
            frame = {"base": 0, "flange": 6, "plate": 7, "table": 8}.get(body.on, body.on)
            link = arm.tip if owner == "flange" else owner
            still = frame == 0 and owner == "base" or frame > 6
            self.frame_of.append(frame)
            self.frame_from_owner.append(np.eye(4) if still else np.linalg.inv(frames[frame]) @ arm.base_from(link, zero)[0])
        self.frame_from_owner = np.array(self.frame_from_owner)
        self.requests = fcl.CollisionRequest()
        self.checks = 0

    def place(self, configuration):
        frames = [np.eye(4)]
        for step, axis, angle in zip(self.steps, self.axes, configuration):
            frames.append(frames[-1] @ step @ turn(axis, angle))
        frames.append(self.cell.base_from_table @ turn((0.0, 0.0, 1.0), configuration[6]))
        frames.append(self.cell.base_from_table)
        return np.array(frames)[self.frame_of] @ self.frame_from_owner

    def is_free(self, configuration):
        self.checks += 1
        placed = self.place(configuration)
        turned = placed[:, :3, :3]
        centres = np.einsum("nij,nj->ni", turned, self.centres) + placed[:, :3, 3]
        halves = np.einsum("nij,nj->ni", np.abs(turned), self.halves)
        apart = np.abs(centres[self.first] - centres[self.second]) - halves[self.first] - halves[self.second]
        for pair in np.flatnonzero((apart <= 0.0).all(axis=1)):
            ends = []
            for body in (self.first[pair], self.second[pair]):
                matrix = placed[body] @ self.cell.bodies[body].body_from_solid
                self.objects[body].setTransform(fcl.Transform(matrix[:3, :3], matrix[:3, 3]))
                ends.append(self.objects[body])
            if fcl.collide(*ends, self.requests, fcl.CollisionResult()):
                return False
        return True

    def is_confirmed(self, way):
        samples = [way[0]]
        for start, end in zip(way, way[1:]):
            pieces = max(1, int(np.ceil(np.abs(end - start).max() / STEP_CONFIRMED_RAD)))
            samples += [start + share * (end - start) for share in np.arange(1, pieces + 1) / pieces]
        placed = self.cell.place(np.array(samples))
        for (a, b), gaps in zip(self.cell.pairs, self.cell.gaps(placed)):
            if any(self.cell.touch(a, b, placed[a][i], placed[b][i]) for i in np.flatnonzero(gaps == 0.0)):
                return False
        return True


def solved(checker, question, seconds):
    low, high = np.array(question["low"]), np.array(question["high"])
    space, bounds = base.RealVectorStateSpace(AXES), base.RealVectorBounds(AXES)
    for axis in range(AXES):
        bounds.setLow(axis, low[axis])
        bounds.setHigh(axis, high[axis])
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: checker.is_free(np.array([state[axis] for axis in range(AXES)])))
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(STEP_RAD / np.linalg.norm(high - low))

    def state(configuration):
        made = space.allocState()
        for axis in range(AXES):
            made[axis] = configuration[axis]
        return made

    setup.setStartState(state(question["home"]))
    goals = base.GoalStates(information)
    for goal in question["goals"]:
        goals.addState(state(goal))
    setup.setGoal(goals)
    setup.setPlanner(geometric.RRTConnect(information))
    setup.solve(seconds)
    if not setup.haveExactSolutionPath():
        return False
    way = [np.array([state[axis] for axis in range(AXES)]) for state in setup.getSolutionPath().getStates()]
    return checker.is_confirmed(way)


def main():
    each, all_seconds = float(sys.argv[1]), float(sys.argv[2])
    checker = Checker(read_cell(sys.stdin.readline()))
    began = time.monotonic()
    for line in sys.stdin:
        then, checker.checks = time.monotonic(), 0
        left = all_seconds - (then - began)
        # A question that cannot have its whole time is not asked.
        if left < each:
            print(json.dumps({"asked": False, "solved": False, "checks": 0, "seconds": 0.0}), flush=True)
            continue
        found = solved(checker, json.loads(line), each)
        spent = time.monotonic() - then
        print(json.dumps({"asked": True, "solved": found, "checks": checker.checks, "seconds": spent}), flush=True)


main()
