"""The maker's Python SDK as a client: `hans_client.py CPS.py PORT` connects to a controller on this machine, reads it, moves the arm
there and back and stops it on the way, and prints what it saw as one line of JSON."""
import contextlib
import importlib.util
import io
import json
import sys
import time

HOME = [0.0, -30.0, 60.0, 0.0, 30.0, 0.0]
AWAY = [20.0, -10.0, 70.0, 15.0, 30.0, -25.0]


def main(path, port):
    spec = importlib.util.spec_from_file_location("cps", path)
    cps = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(cps)
    # Its log goes to another port by XML-RPC, which is not simulated.
    cps.RbtClient.sendHRLog = lambda self, level, message: None
    robot = cps.CPSClient()
    seen = {"connect": robot.HRIF_Connect(0, "127.0.0.1", port)}

    def values(name, *arguments):
        result = []
        code = getattr(robot, name)(0, *arguments, result)
        assert code == 0, f"{name}: {code}"
        return result

    def settle():
        deadline = time.monotonic() + 10
        while time.monotonic() < deadline:
            state = values("HRIF_ReadRobotState", 0)
            if state[0] == "0" and state[11] == "1" and state[12] == "1":
                return
            time.sleep(0.01)
        raise TimeoutError

    def joints():
        return [float(value) for value in values("HRIF_ReadActPos", 0)[6:12]]

    def move(target):
        pose = ["420", "0", "445", "180", "0", "180"]
        return robot.HRIF_WayPoint(0, 0, 0, pose, target, "TCP", "Base", 90, 300, 0, 1, 0, 0, 0, "ID1")

    seen["model"] = values("HRIF_ReadRobotModel", 0)
    seen["fsm"] = values("HRIF_ReadCurFSM", 0)[:1]
    seen["moved"] = []
    for target in (AWAY, HOME):
        code = move(target)
        settle()
        seen["moved"].append([code, joints()])
    seen["busy"] = [move([90.0] + HOME[1:]), move(HOME)]
    seen["stop"] = robot.HRIF_GrpStop(0, 0)
    time.sleep(0.5)
    rest = joints()
    time.sleep(0.3)
    seen["rests"] = joints() == rest and 0 < rest[0] < 90
    return seen


if __name__ == "__main__":
    chatter = io.StringIO()
    with contextlib.redirect_stdout(chatter):
        found = main(sys.argv[1], int(sys.argv[2]))
    print(json.dumps(found))
