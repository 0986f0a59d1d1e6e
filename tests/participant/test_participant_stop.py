"""When a participant ends, whatever is still under way to it."""

import msgspec
import pytest

from stepbus_participant import Endpoint, JointCommand, JointState, Participant, Ticket, take_part
from stepbus_schemas import (
    InputConfig,
    OutputConfig,
    Outputs,
    Start,
    Stop,
    Trigger,
    Welcome,
    encode,
)

TOKEN = "00c0ffee00c0ffee"
STEP_NS = 5_000_000


class Bus:
    """Hands over a script of (key, message) as soon as the participant is ready."""

    def __init__(self, welcome, script):
        self.welcome, self.script = welcome, script
        self.sinks = {}
        self.published = []

    def declare_alive(self, key):
        self.alive = key

    def watch_alive(self, key, sink):
        sink(key, True)

    def subscribe(self, key, sink):
        self.sinks[key] = sink
        if key == "out/controller":
            sink(encode(Outputs(token=TOKEN, step=-1, t_ns=0)))

    def payload(self, sample):
        return sample

    def query(self, key, data, encoding, timeout_s):
        return [encode(self.welcome)]

    def publisher(self, key, encoding):
        return lambda data: self.take(key, data)

    def take(self, key, data):
        if key == "out/plant":
            self.published.append(msgspec.msgpack.decode(data)["step"])
        if key.startswith("ready/"):
            while self.script:
                to, message = self.script.pop(0)
                self.sinks[to](encode(message))


class Plant(Participant):
    def output(self, step):
        return {"joint_state": JointState(position=[step.t])}

    def update(self, step):
        step.read("command", JointCommand)


def command(step):
    data = encode(JointCommand(mode="torque", values=[0.0]))
    ports = {"command": msgspec.Raw(data)}
    return "out/controller", Outputs(token=TOKEN, step=step, t_ns=step * STEP_NS, ports=ports)


def published(*script):
    """Return the steps a plant publishes, its handshakes left out."""
    source = InputConfig(source="controller", port="command", type="JointCommand/1")
    welcome = Welcome(
        protocol=1, name="plant", token=TOKEN, step_ns=STEP_NS, every=1, publishes="first", window=8, batch=4,
        seed=0, inputs={"command": source}, outputs={"joint_state": OutputConfig(type="JointState/1")},
        params={}, folder="/",
    )  # fmt: skip
    start = ("start", Start(token=TOKEN, inputs={}))
    bus = Bus(welcome, [start, ("trigger", Trigger(token=TOKEN, step_limit=8)), *script])
    endpoint = Endpoint(listen=[], connect=[])
    take_part(Plant, Ticket(run="r", name="plant", token=TOKEN, endpoint=endpoint), bus)
    return [step for step in bus.published if step >= 0]


def stop(at_step):
    return "stop", Stop(token=TOKEN, reason="finished", at_step=at_step)


@pytest.mark.parametrize(
    "script",
    [
        [command(0), command(1), stop(2)],
        [command(0), stop(2), command(1)],
        [stop(2), command(0), command(1)],
        [stop(2), stop(2), command(0), stop(2), command(1)],
    ],
)
def test_the_steps_before_the_stop_are_finished_in_whatever_order_messages_come(script):
    assert published(*script) == [0, 1, 2]


def test_a_stop_at_a_step_that_is_behind_ends_at_once():
    assert published(command(0), command(1), command(2), stop(2))[:3] == [0, 1, 2]


def test_a_negative_step_ends_at_once():
    assert published(stop(-1)) in ([], [0])
