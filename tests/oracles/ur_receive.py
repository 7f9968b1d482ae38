"""Universal Robots RTDE by ur_rtde, as a client of a controller at the address given (its port is always 30004): prints the lowest and
the highest angle of joint 1 that it reads until a line comes on stdin, and the last one, radians."""
import sys
import threading
import time

import rtde_receive

arm = rtde_receive.RTDEReceiveInterface(sys.argv[1], 125.0, ["timestamp", "actual_q", "robot_mode", "safety_status_bits", "runtime_state"])
over = threading.Event()
threading.Thread(target=lambda: (sys.stdin.readline(), over.set()), daemon=True).start()
read = [arm.getActualQ()[0]]
assert arm.getRobotMode() == 7, arm.getRobotMode()
print("reading", flush=True)
while not over.is_set():
    read.append(arm.getActualQ()[0])
    time.sleep(0.005)
print(min(read), max(read), read[-1], flush=True)
arm.disconnect()
