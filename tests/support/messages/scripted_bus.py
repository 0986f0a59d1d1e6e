"""A bus that gives a plant a script of messages, without processes."""

import time
from queue import SimpleQueue

import msgspec

from stepbus_participant import Endpoint, Ticket, take_part
from stepbus_schemas import (
    InputConfig,
    JointCommand,
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
    """Delivers a script of (key, message) as soon as the participant is ready.

    later: another, once it reports that it waits.
    """

    clock, exchange = time, None
    queue = SimpleQueue

    def __init__(self, welcome, script, later=()):
        self.welcome, self.script, self.later = welcome, script, list(later)
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

    subscribe_content = subscribe

    def query(self, key, data, encoding, timeout_s):
        return [encode(self.welcome)]

    def publisher(self, key, encoding, *, remote=False):
        return lambda data: self.take(key, data)

    def take(self, key, data):
        if key == "out/plant":
            self.published.append(msgspec.msgpack.decode(data))
        if key.startswith("ready/"):
            self.deliver(self.script)
        if key.startswith("log/") and msgspec.msgpack.decode(data).get("waiting"):
            self.deliver(self.later)

    def deliver(self, script):
        while script:
            to, message = script.pop(0)
            self.sinks[to](message if isinstance(message, bytes) else encode(message))


def command(step):
    data = encode(JointCommand(mode="torque", values=[0.0]))
    ports = {"command": msgspec.Raw(data)}
    return "out/controller", Outputs(token=TOKEN, step=step, t_ns=step * STEP_NS, ports=ports)


def run_plant(factory, *script, publishes="first", step_limit=8, later=()):
    """Return the outputs that a plant publishes, without its handshakes; later: see `Bus`."""
    source = InputConfig(source="controller", port="command", type="JointCommand/1")
    welcome = Welcome(
        protocol=2, name="plant", token=TOKEN, step_ns=STEP_NS, every=1, publishes=publishes, window=8, batch=4,
        seed=0, inputs={"command": source}, outputs={"joint_state": OutputConfig(type="JointState/1")},
        params={}, folder="/",
    )  # fmt: skip
    start = ("start", Start(token=TOKEN, inputs={}))
    trigger = ("trigger", Trigger(token=TOKEN, step_limit=step_limit))
    bus = Bus(welcome, [start, trigger, *script], later)
    endpoint = Endpoint(listen=[], connect=[])
    take_part(factory, Ticket(run="r", name="plant", token=TOKEN, endpoint=endpoint), bus)
    return [outputs for outputs in bus.published if outputs["step"] >= 0]


def stop(at_step):
    return "stop", Stop(token=TOKEN, reason="finished", at_step=at_step)
