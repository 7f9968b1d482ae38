# Vantage scan program. File name: vantage.py
# Plan SHA-256 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
# Setup 1, 2 scans, predicted cycle 16.5 s
# Cell e05-transcan, robot hans-e05, turntable minas-a6-500
# Units: deg, deg/s, deg/s2, s.
# WARNING: not safety-rated. Guarding, speed limits and stops belong to the cell's safety system.
# WARNING: run first at reduced speed, nobody in the cell, a hand on the stop.
# WARNING: checked in the model of the cell WITHOUT the part: what hits the part was not looked for.
# Payload to be set on the controller: 2.70 kg at the flange, and cables.
# Table: a synchronised external axis of the robot, the seventh angle; it moves with the arm.
# Each point is a stop: the paths between them were checked as straight joint moves.
# Scan: output 1 on for 0.1 s starts it; input 1 on ends it, after 30 s the program stops. Input 1 has
# to be off before the next scan: the program waits for that, 30 s at most, and then stops.
# The station has a robot of the name below; I/O numbers are the robot's.
from robodk.robolink import ITEM_TYPE_ROBOT, Robolink

HOME = [0.000000, -30.000000, 60.000000, 0.000000, 30.000000, 0.000000, 0.000000]
station = Robolink()
# A wait that times out has to stop the script; RoboDK may report it as a warning, which is only printed by default.
station._RAISE_EXCEPTION_ON_WARNING = True
robot = station.Item("hans-e05", ITEM_TYPE_ROBOT)
if not robot.Valid():
    raise SystemExit("the station has no robot of this name")
here = robot.Joints().list()
if len(here) != 7:
    raise SystemExit("the robot has no table: synchronise it as an external axis")
# The paths begin at home; from anywhere else they were not checked.
if max(abs(a - b) for a, b in zip(here, HOME)) > 0.5:
    raise SystemExit("arm and table are not at home; bring them there by hand")
robot.setRounding(-1)


def move(angles_deg, speed, acceleration):
    robot.setSpeed(-1, speed, -1, acceleration)
    robot.MoveJ(angles_deg)


def scan():
    robot.waitDI(1, 0, 30000)
    robot.setDO(1, 1)
    robot.Pause(100)
    robot.setDO(1, 0)
    robot.waitDI(1, 1, 30000)

# to viewpoint 4
move([0.000000, -30.000000, 60.000000, 0.000000, 30.000000, 0.000000, 30.000000], 11.2500, 22.5000)
move([5.000000, -30.000000, 60.000000, 0.000000, 30.000000, 0.000000, 30.000000], 22.4885, 179.9085)
move([10.123457, -33.000000, 64.000000, 5.000000, 24.000000, 7.000000, 45.000000], 11.2500, 22.5000)
robot.Pause(300)
# scan viewpoint 4, brightness 5
scan()
# to viewpoint 0
move([-10.000000, -33.000000, 64.000000, -0.000010, 30.000000, -7.654321, -20.000000], 11.2500, 22.5000)
robot.Pause(300)
# scan viewpoint 0, brightness 5
scan()
# home
move([0.000000, -30.000000, 60.000000, 0.000000, 30.000000, 0.000000, 0.000000], 11.2500, 22.5000)
