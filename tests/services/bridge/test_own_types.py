"""Programs behind the bridge with message types of their own."""

import json
import math
import sys

import pytest
from support.services.control import make_config

from stepbus.testing import feed
from stepbus_bridge.map_bridge import MapBridge
from stepbus_bridge.raw_bridge import RawBridge
from stepbus_schemas import Description, LaserScan, Types, WiringError

TYPES = Types({"Thruster/1": {"thrust": "float[n]", "mode": ["off", "on"]}})
Thruster = TYPES["Thruster/1"]

JSON = """
import json, os
read, write = os.fdopen(3), os.fdopen(4, "w", buffering=1)
say = lambda value: print(json.dumps(value), file=write)
welcome = json.loads(read.readline())["welcome"]
say({{"ready": {ready}}})
read.readline()
update = json.loads(read.readline())["update"]
mode = welcome["types"]["Thruster/1"]["mode"]["type"][1]
say({{"outputs": {{"out": {{"thrust": update["inputs"]["in"]["thrust"][::-1], "mode": mode}}}}}})
"""

RAW = """
import os, struct
read, write = os.fdopen(3, "rb"), os.fdopen(4, "wb", buffering=0)
write.write(struct.pack("<d", 1.0))
header = struct.unpack("<8d", read.read(64))
n_in, n_out = map(int, header[4:6])
numbers = struct.unpack(f"<{n_in}d", read.read(8 * n_in))
write.write(struct.pack(f"<{n_out}d", *ANSWER))
"""


def config(source="Thruster/1"):
    outputs = {"out": "Thruster/1"}
    return make_config("controller", {"in": source}, outputs, params={}, types=TYPES)


@pytest.fixture
def started():
    """Return a function that makes a bridge to a program in Python."""
    made = []

    def start(cls, form, program, description, settings=None):
        argv = [sys.executable, "-c", program]
        describe = {"out": Description(names=["left", "right"])}
        made.append(cls(settings or config(), argv, form, describe))
        made[-1].describe()
        made[-1].start({"in": description})
        return made[-1]

    yield start
    for item in made:
        item.program.failed = True
        item.close()


def test_a_json_program_gets_the_declarations_and_messages_of_its_types(started):
    bridge = started(MapBridge, "json", JSON.format(ready="{}"), Description())
    answer = bridge.update(feed(0, **{"in": Thruster(thrust=[1.0, 2.0], mode="off")}))
    assert answer["out"] == Thruster(thrust=[2.0, 1.0], mode="on")


def test_a_json_program_that_declares_another_type_is_refused(started):
    declared = {"types": {"Thruster/1": {"thrust": {"type": "float[n]", "unit": "kN"}}}}
    with pytest.raises(WiringError, match=r"thrust is of type float\[n\], unit \"kN\""):
        started(MapBridge, "json", JSON.format(ready=json.dumps(declared)), Description())


def test_a_raw_program_gets_and_gives_the_numbers_of_its_types(started):
    program = RAW.replace("ANSWER", "(numbers[3], numbers[4], 1 - numbers[5])")
    bridge = started(RawBridge, "raw", program, Description(names=["right", "left"]))
    answer = bridge.update(feed(0, **{"in": Thruster(thrust=[1.0, 2.0], mode="off")}))
    # Its input is reordered to the names of its output.
    assert answer["out"] == Thruster(thrust=[2.0, 1.0], mode="on")


def test_a_raw_program_gets_a_scan_whose_length_the_description_says(started):
    program = RAW.replace("ANSWER", "(numbers[7], n_in, 0.0)")
    settings = config(source="LaserScan/1")
    bridge = started(RawBridge, "raw", program, Description(shape=[2]), settings)
    scan = LaserScan(
        angle_min=0.0, angle_increment=1.0, range_min=0.0, range_max=9.0, ranges=[5.0, math.inf]
    )
    assert bridge.update(feed(0, **{"in": scan}))["out"].thrust == [5.0, 2 + 1 + 4 + 2 + 2]


def test_a_scan_of_unknown_length_cannot_be_numbers(started):
    settings = config(source="LaserScan/1")
    with pytest.raises(WiringError, match="needs the length of input 'in'"):
        started(RawBridge, "raw", RAW, Description(), settings)
