"""Inverse kinematics by EAIK: a line {"axes": [6 × 3], "offsets": [7 × 3]} on stdin, unit axes and the steps from axis to axis
as the arm stands at zero, metres; then a pose a line, 16 numbers of a 4 × 4 matrix row by row, its rotation against that at
zero. For each a line on stdout with the list of joint vectors, radians, that reach it exactly."""
import json
import sys

import numpy as np
from eaik.IK_HP import HPRobot

arm = json.loads(sys.stdin.readline())
robot = HPRobot(np.array(arm["axes"]), np.array(arm["offsets"]))
if not robot.hasKnownDecomposition():
    sys.exit("EAIK knows no decomposition of this arm")
for line in sys.stdin:
    found = robot.IK(np.array(json.loads(line)).reshape(4, 4))
    print(json.dumps([[float(q) for q in joints] for joints, approximate in zip(found.Q, found.is_LS) if not approximate]))
