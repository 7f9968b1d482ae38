"""FANUC RMI by fanuc_ucl, as the client of a controller at the address given (its port is always 16001): moves there and back, and
prints the joints that it then reads, degrees as the controller counts them: there on one line, back on another."""
import sys

from fanuc_ucl import JointFormat, JointTemplate, rmi

GOAL_DEG = [5.0, 10.0, -15.0, 20.0, -25.0, 30.0]
MOVE_MS = 300

driver = rmi.RmiDriver(rmi.RmiDriverConfig(sys.argv[1]))
driver.connect()
driver.send_full_reset().wait_timeout(10.0)
driver.send(rmi.FrcInitialize()).wait_timeout(10.0)
driver.send(rmi.FrcSetOverRide(80)).wait_timeout(5.0)
status = driver.send(rmi.FrcGetStatus()).wait_timeout(5.0)
assert status.servo_ready == 1 and status.rmi_motion_status == 1, status
for goal in (GOAL_DEG, [0.0] * 6):
    joints = rmi.JointAngles(JointFormat.FanucDeg, JointTemplate.SIX, *goal)
    move = rmi.FrcJointMotionJRep(joints, rmi.SpeedType.MilliSeconds, MOVE_MS, rmi.TermType.FINE, 0)
    driver.send(move).wait_timeout(10.0)
    read = driver.send(rmi.FrcReadJointAngles()).wait_timeout(5.0)
    print(*read.joints(JointFormat.FanucDeg, JointTemplate.SIX).as_array()[:6], flush=True)
driver.send(rmi.FrcAbort()).wait_timeout(5.0)
