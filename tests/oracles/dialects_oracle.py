"""Runs a RoboDK script without RoboDK: dialects_oracle.py SCRIPT ROBOT HOME [INPUT].

The package is the vendor's. Only the connection is replaced: a robot that stands at HOME (degrees, separated by commas)
takes the calls that robodk.robolink.Item has, with arguments that bind to its signatures, and prints them as JSON. With
INPUT, 0 or 1, its inputs stay at that value: a wait for the other one times out. RoboDK's answer is then a warning, the
mildest that it has for a call that failed, and goes through the package's own `_check_status`; it has to end the script.
"""

import contextlib
import inspect
import io
import json
import runpy
import struct
import sys

from robodk import robolink, robomath

script, robot_name, home = sys.argv[1], sys.argv[2], [float(angle) for angle in sys.argv[3].split(",")]
held = int(sys.argv[4]) if sys.argv[4:] else None
Robolink = robolink.Robolink
WARNING = 2
TIMED_OUT = "timed out"
calls = []


class Answer:
    """Takes the place of the socket: it holds what RoboDK sends back."""

    def __init__(self, status, line):
        self.recv = io.BytesIO(struct.pack(">i", status) + line.encode() + b"\n").read


class Robot:
    def __init__(self, link):
        self.link = link

    def Valid(self, check_deleted=False):
        return True

    def Joints(self):
        return robomath.Mat([[angle] for angle in home])

    def __getattr__(self, name):
        method = getattr(robolink.Item, name)

        def call(*arguments, **named):
            bound = inspect.signature(method).bind(self, *arguments, **named)
            given = list(bound.arguments.values())[1:]
            flat = [x for argument in given for x in (argument if isinstance(argument, list) else [argument])]
            calls.append({"name": name, "arguments": [float(x) for x in flat]})
            if name == "waitDI" and held not in (None, given[1]):
                self.link.COM = Answer(WARNING, TIMED_OUT)
                self.link._check_status()

        return call


class Station(Robolink):
    def __init__(self, *arguments, **named):
        inspect.signature(Robolink.__init__).bind(self, *arguments, **named)

    def __del__(self):
        """Does nothing: there is no connection to end."""

    def Item(self, name, itemtype=None):
        assert (name, itemtype) == (robot_name, robolink.ITEM_TYPE_ROBOT), (name, itemtype)
        return Robot(self)


robolink.Robolink = Station
# The package prints warnings.
with contextlib.redirect_stdout(sys.stderr):
    try:
        runpy.run_path(script, run_name="__main__")
    except Exception as error:
        if str(error) != f"WARNING: {TIMED_OUT}":
            raise
        assert held is not None
json.dump(calls, sys.stdout)
