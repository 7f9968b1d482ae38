"""Runs a RoboDK script without RoboDK: dialects_oracle.py SCRIPT ROBOT HOME.

The package is the vendor's. Only the connection is replaced: a robot that stands at HOME (degrees, separated by commas)
takes the calls that robodk.robolink.Item has, with arguments that bind to its signatures, and prints them as JSON.
"""

import inspect
import json
import runpy
import sys

from robodk import robolink, robomath

script, robot_name, home = sys.argv[1], sys.argv[2], [float(angle) for angle in sys.argv[3].split(",")]
calls = []


class Robot:
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

        return call


class Station:
    def __init__(self, *arguments, **named):
        inspect.signature(robolink.Robolink.__init__).bind(self, *arguments, **named)

    def Item(self, name, itemtype=None):
        assert (name, itemtype) == (robot_name, robolink.ITEM_TYPE_ROBOT), (name, itemtype)
        return Robot()


robolink.Robolink = Station
runpy.run_path(script, run_name="__main__")
json.dump(calls, sys.stdout)
