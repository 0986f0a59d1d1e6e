"""The worked example of docs/protocol.md, against the codec and against our own participant."""

import json
import re
import time
from queue import SimpleQueue
from types import SimpleNamespace
from typing import NamedTuple

import msgspec
import pytest
from mcap.reader import make_reader
from support.paths import DOCS, PROGRAMS
from support.runs.joints import run_joints

import stepbus_participant.session.admission
from stepbus_participant import Endpoint, Participant, Ticket, take_part
from stepbus_participant.bus.zenoh_bus import zenoh_settings
from stepbus_schemas import (
    ENVELOPE_TYPES,
    Decoder,
    Description,
    JointCommand,
    JointState,
    encode,
    encoding_of,
)

PAGE = (DOCS / "protocol.md").read_text(encoding="utf-8")
EXAMPLE = re.compile(
    r"\*\*(\d+)\. (sent|received) on `(\S+)`: `(\S+)`, (\d+) bytes\*\*\n\n"
    r"```json\n(.*?)```\n\n```hex\n(.*?)```",
    re.DOTALL,
)
TOKEN = "00c0ffee00c0ffee"


class Row(NamedTuple):
    number: str
    direction: str
    key: str
    type: str
    size: str
    json: str
    hex: str

    @property
    def data(self):
        return bytes.fromhex(self.hex)


ROWS = [Row(*found) for found in EXAMPLE.findall(PAGE)]


def taken(direction):
    """Return (key, encoding, content) of all messages in one direction, in their order."""
    rows = [row for row in ROWS if row.direction == direction]
    return [(row.key, encoding_of(row.type), row.data) for row in rows]


class ScriptedBus:
    """Gives a participant the messages of the example, and keeps what it sends."""

    clock = SimpleNamespace(monotonic=time.monotonic, monotonic_ns=int)
    queue = SimpleQueue
    exchange = None

    def __init__(self):
        self.sent = []
        self.sinks = {}
        self.received = taken("received")

    def declare_alive(self, key):
        self.sinks[key] = None

    def watch_alive(self, key, sink):
        sink(key, True)

    def subscribe(self, key, sink):
        self.sinks[key] = sink

    subscribe_content = subscribe

    def query(self, key, data, encoding, timeout_s):
        self.sent.append((key, encoding, data))
        return [self.received.pop(0)[2]]

    def publisher(self, key, encoding):
        return lambda data: self.take(key, encoding, data)

    def take(self, key, encoding, data):
        """Keep a message; give what the example has between it and the next one sent."""
        self.sent.append((key, encoding, data))
        following = [row.direction for row in ROWS][len(self.sent) + self.given :]
        while following and following.pop(0) == "received":
            other, _, content = self.received.pop(0)
            self.sinks[other](content)

    @property
    def given(self):
        return len(taken("received")) - len(self.received)


class Spring(Participant):
    def describe(self):
        return {"command": Description(like="joint_state")}

    def update(self, step):
        position = step.read("joint_state", JointState).position[0]
        torque = self.config.param("kp") * (0.25 - position)
        return {"command": JointCommand(mode="torque", values=[torque])}


def test_the_page_has_a_whole_run():
    assert [row.number for row in ROWS] == [str(index + 1) for index in range(16)]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.number)
def test_the_bytes_of_the_page_are_those_of_the_codec(row):
    message = Decoder(ENVELOPE_TYPES[row.type])(row.data)
    assert encode(message) == row.data
    assert len(row.data) == int(row.size)
    assert msgspec.msgpack.decode(row.data) == msgspec.json.decode(row.json)


def test_our_participant_given_what_is_received_sends_what_is_sent(monkeypatch):
    monkeypatch.setattr(stepbus_participant.session.admission.os, "getpid", lambda: 4711)
    monkeypatch.setattr(
        stepbus_participant.session.admission, "installed_version", lambda name: "0.1.0"
    )
    bus = ScriptedBus()
    endpoint = Endpoint(listen=[], connect=[])
    take_part(Spring, Ticket(run="r", name="controller", token=TOKEN, endpoint=endpoint), bus)
    assert bus.sent == taken("sent")


def settings_of_the_page(column):
    """Return path → value, as written in the tables of P2."""
    section = PAGE[PAGE.index("## P2 ") : PAGE.index("## P3 ")]
    lines = [line for line in section.splitlines() if line.startswith("| `")]
    rows = [[cell.strip(" `") for cell in line.strip("|").split(" | ")] for line in lines]
    values = {row[0]: row[min(column, len(row) - 1)] for row in rows}
    return {path: value for path, value in values.items() if value != "not set"}


@pytest.mark.parametrize(("low_latency", "column"), [(True, 1), (False, 2)])
def test_the_settings_of_a_session_are_those_of_the_page(low_latency, column):
    people = {"user": "me", "password": "secret"}
    endpoint = Endpoint(listen=["a"], connect=["b"], low_latency=low_latency, **people)
    page, ours = settings_of_the_page(column), zenoh_settings(endpoint, "file")
    assert page.keys() == ours.keys()
    from_ticket = {path for path in page if "endpoints" in path or "usrpwd" in path}
    assert zenoh_settings(Endpoint(listen=[], connect=[], settings={"x/y": 1}), None)["x/y"] == 1
    assert {path: json.loads(page[path]) for path in page.keys() - from_ticket} == {
        path: ours[path] for path in ours.keys() - from_ticket
    }


def outputs_of(result):
    """Return (topic, step, content) of all that was recorded."""
    with result.recording.open("rb") as file:
        found = make_reader(file).iter_messages(log_time_order=False)
        return [(channel.topic, message.sequence, message.data) for _, channel, message in found]


@pytest.mark.parametrize("settings", [["window=64"], ["window=1", "batch=1"]])
def test_a_program_written_from_the_page_alone_publishes_what_ours_does(tmp_path, settings):
    program = PROGRAMS / "by_the_page.py"
    (tmp_path / "source").mkdir()
    (tmp_path / "source/by_the_page.py").write_bytes(program.read_bytes())
    theirs = run_joints(tmp_path, "controller.exec=[python, by_the_page.py]", *settings)
    ours = run_joints(tmp_path / "ours", *settings, in_process=True)
    assert (theirs.exit_code, theirs.reason, theirs.unauthenticated) == (0, "finished", 0)
    assert outputs_of(theirs) == outputs_of(ours)
