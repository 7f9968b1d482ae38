"""ABB EGM by abb-robot-client, as the client of a controller that sends to the port given: moves joint 1 and external axis 1 there and
back in steps, a step a report, and prints where the controller then says that they are, degrees: there on one line, back on another."""
import sys

import numpy as np
from abb_robot_client.egm import EGM

STEPS = 50
GOAL_DEG = 5.0

egm = EGM(port=int(sys.argv[1]))


def report():
    received, state = egm.receive_from_robot(timeout=10.0)
    assert received, "no report within ten seconds"
    return state


start = report()
assert start.motors_on and start.rapid_running, start
joints, table = np.array(start.joint_angles), np.array(start.external_axes)


def go(from_deg, to_deg):
    for step in range(1, STEPS + 1):
        offset = from_deg + (to_deg - from_deg) * step / STEPS
        report()
        assert egm.send_to_robot(joints + [offset, 0, 0, 0, 0, 0], external_joints=table + offset * (np.arange(len(table)) == 0))
    for _ in range(5):
        state = report()
        assert egm.send_to_robot(joints + [to_deg, 0, 0, 0, 0, 0], external_joints=table + to_deg * (np.arange(len(table)) == 0))
    print(*state.joint_angles, *state.external_axes, flush=True)


go(0.0, GOAL_DEG)
go(GOAL_DEG, 0.0)
egm.close()
