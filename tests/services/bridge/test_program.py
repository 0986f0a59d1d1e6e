"""What a program behind the bridge does wrong is told apart, with a real program and no bus."""

import os
import re
import signal
import sys

import pytest
from support.runs.bridge import BRIDGED
from support.services.control import make_config

from stepbus.testing import feed
from stepbus_bridge.bridge import BridgeError
from stepbus_bridge.map_bridge import MapBridge
from stepbus_bridge.raw_bridge import RawBridge
from stepbus_schemas import Description, JointCommand, JointState, WiringError

JOINTS = {"joint_state": Description(names=["knee", "hip"])}
FORMS = ["json", "msgpack"]
RIGHT = [sys.executable, str(BRIDGED), "json", "right", "1"]


def config(outputs=("JointCommand/1",), **changes):
    ports = dict(zip(("command", "news"), outputs, strict=False))
    inputs, params = {"joint_state": "JointState/1"}, {"kp": 2, "law": "pd"}
    return make_config("controller", inputs, ports, params=params, **changes)


def step_at(index, position):
    return feed(index, joint_state=JointState(position=position))


@pytest.fixture
def bridge():
    """Return a function that makes a bridge to a program that goes wrong at step 1."""
    made = []

    def make(form, kind, words=None, **changes):
        words = words or [sys.executable, str(BRIDGED), form, kind, "1"]
        cls = RawBridge if form == "raw" else MapBridge
        made.append(cls(config(**changes), words, form, {}))
        made[-1].describe()
        made[-1].start(JOINTS)
        return made[-1]

    yield make
    for item in made:
        item.program.failed = True
        if not item.program.has_ended():
            os.kill(item.program.pid, signal.SIGKILL)
        item.close()


@pytest.mark.parametrize("form", [*FORMS, "raw"])
def test_the_answer_to_a_step_is_its_outputs(bridge, form):
    outputs = bridge(form, "right").update(step_at(0, [0.1, 1e300]))
    assert outputs == {"command": JointCommand(mode="torque", values=[0.05, 5e299])}


WRONG = {
    "garbage": r"wrote .*: (JSON|MessagePack data) is malformed: invalid",
    "mistyped": r"gave an invalid answer: outputs\.command\.values: Expected `array`, got `str`; its outputs are command \(JointCommand/1\)",
    "word": r"outputs\.command\.mode: must be brake, position, teleport, torque or velocity, not \'torqe\'; did you mean 'torque'\?; its outputs are",
    "lacking": r"gave an invalid answer: outputs\.command: Object missing required field `values`",
    "port": r"gave an invalid answer: .*unknown field `komand`.*its outputs are command",
    "twice": r"wrote .* after its answer",
    "oversize": r"wrote a message of \d+ bytes; the limit is 16777216",
    "raise": r"exited with code 3; its last output|exited with code 3$",
    "kill": r"was killed by SIGKILL",
    "close": r"closed descriptor 4 but is still running",
    "half": r"wrote an incomplete message: \d+ bytes (of \d+|without its end) \(",
    "cut": r"exited with code 0 after an incomplete message: \d+ ",
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", WRONG)
def test_each_mistake_has_its_own_sentence(bridge, form, kind):
    made = bridge(form, kind)
    made.update(step_at(0, [0.0, 1.0]))
    with pytest.raises(BridgeError, match=WRONG[kind]) as caught:
        made.update(step_at(1, [0.0, 1.0]))
    assert re.match(rf"python\S* .*bridged\.py {form} .*\(pid \d+\) ", str(caught.value))


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("mode", r"gave an invalid answer: command: mode 7 is none of 0 \(torque\)"),
        ("half", r"wrote an incomplete message: 12 bytes of 24 \("),
        ("twice", r"wrote .* after its answer"),
    ],
)
def test_each_mistake_in_numbers_has_its_own_sentence(bridge, kind, sentence):
    with pytest.raises(BridgeError, match=sentence):
        bridge("raw", kind).update(step_at(1, [0.0, 1.0]))


def test_a_word_that_nobody_asked_for_is_refused_at_the_next_step(bridge):
    code = "import os; os.read(3, 4096); os.write(4, b'{\"ready\": {}}\\n'); os.read(3, 4096); os.write(4, b'{}\\n'); os.read(3, 1)"
    made = bridge("json", "", [sys.executable, "-c", code])
    assert made.program.has_written(timeout_s=20)
    with pytest.raises(BridgeError, match=r"wrote '\{\}\\n' without being asked"):
        made.update(step_at(0, [0.0, 1.0]))


def test_null_in_a_list_of_numbers_is_nan(bridge):
    values = bridge("json", "nan").update(step_at(1, [0.0, 1.0]))["command"].values
    assert [str(v) for v in values] == ["nan", "nan"]


@pytest.mark.parametrize("form", FORMS)
def test_whole_numbers_are_floats_and_unknown_fields_are_ignored(bridge, form):
    values = bridge(form, "whole").update(step_at(1, [0.0, 1.0]))["command"].values
    assert [(type(v), v) for v in values] == [(float, 1.0), (float, -2.0)]


@pytest.mark.parametrize("form", FORMS)
def test_a_program_may_ask_for_the_end_of_the_run(bridge, form):
    step = step_at(1, [0.0, 1.0])
    assert bridge(form, "end").update(step) == {}
    assert step.end_reason == "enough"


def test_one_that_publishes_first_cannot_answer_an_update_with_outputs(bridge):
    with pytest.raises(BridgeError, match="publishes first"):
        bridge("json", "right", publishes="first").update(step_at(0, [0.0, 1.0]))


def test_outputs_with_joints_are_like_the_first_input_with_joints(bridge):
    described = MapBridge(config(["JointCommand/1", "Event/1"]), RIGHT, "json", {})
    try:
        assert described.describe() == {"command": Description(like="joint_state")}
    finally:
        described.close()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["/bin/nodde", "x.mjs"], "cannot start /bin/nodde: No such file or directory"),
        ([str(BRIDGED)], "cannot start .*: Permission denied"),
    ],
)
def test_a_missing_program_is_named(bridge, words, sentence):
    with pytest.raises(WiringError, match=sentence):
        bridge("json", "", words)
