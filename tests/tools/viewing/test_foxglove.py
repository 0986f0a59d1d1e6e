"""The WebSocket for Foxglove and Lichtblick, read by a client that knows only the protocol."""

import base64
import contextlib
import json
import re
import socket
import struct
import subprocess
import sys
import threading
import time

import pytest
from foxglove.messages import CompressedImage
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from support.messages.recordings import write
from support.paused import Paused
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import stepbus
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import Event, JointState, StepbusError
from stepbus_tools.viewing import foxglove_feed
from stepbus_tools.viewing.foxglove_feed import follow, play
from stepbus_tools.viewing.foxglove_server import open_server

STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]
LATEST = "foxglove.sdk.v1"


class Client:
    """Subscribes to all that is advertised. times: that it was told. found: topic → (time, what)."""

    def __init__(self, address, protocol=LATEST):
        self.socket = connect(address, subprotocols=[protocol], max_size=None, open_timeout=60)
        self.types, self.topics, self.found, self.times, self.info = {}, {}, {}, [], None

    def read(self, until):
        """Read until something is true, or the server has gone."""
        try:
            while not until(self):
                self.take(self.socket.recv(timeout=120))
        except ConnectionClosed:
            pass
        return self

    def take(self, data):
        if isinstance(data, str):
            told = json.loads(data)
            self.info = told if told["op"] == "serverInfo" else self.info
            for channel in told.get("channels", ()):
                self.subscribe(channel)
        elif data[0] == 2:
            self.times.append(struct.unpack("<BQ", data)[1])
        else:
            _, number, t_ns = struct.unpack_from("<BIQ", data)
            message = self.types[number].FromString(data[13:])
            self.found.setdefault(self.topics[number], []).append((t_ns, message))

    def subscribe(self, channel):
        number = 1000 + channel["id"]
        files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
        pool = descriptor_pool.DescriptorPool()
        for file in files.file:
            pool.Add(file)
        found = pool.FindMessageTypeByName(channel["schemaName"])
        self.types[number] = message_factory.GetMessageClass(found)
        self.topics[number] = channel["topic"]
        wanted = [{"id": number, "channelId": channel["id"]}]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


@pytest.fixture
def server():
    server = open_server("test")
    yield server
    server.close()


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("foxglove") / "run.mcap"
    return write(
        path,
        joint_state=("JointState/1", ["hip"], [JointState(position=[s / 100]) for s in range(50)]),
        events=(
            "Event/1",
            [],
            [None, Event(level="warning", text="slow"), Event(level="info", text="fast")],
        ),
    )


def watched(work):
    """Do something in a thread, as the process of a view does; returns what ends it."""
    over = threading.Event()
    thread = threading.Thread(target=work, args=(over.is_set,))
    thread.start()

    def end():
        over.set()
        thread.join()

    return end


@pytest.mark.parametrize(
    "protocol", [pytest.param("foxglove.websocket.v1", marks=pytest.mark.slow), LATEST]
)
def test_a_run_is_advertised_and_its_messages_are_those_that_it_records(
    tmp_path, server, plain, protocol, starts_a_process
):
    paused = Paused(tmp_path / "run", load("two_link", ["duration=1s"]))
    end = watched(lambda is_over: follow(server, paused.out, is_over))
    client = Client(server.address, protocol)
    while "/plant/joint_state" not in client.found:
        paused.pace.step()
        client.read(lambda c: c.times)
        client.times.clear()
    result = paused.end()
    client.read(lambda c: c.times and c.times[-1] == 1_000_000_000)
    end()
    assert result.sha256 == plain
    assert client.info["capabilities"] == ["time"]
    assert {"/scene", "/tf", "/plant/joint_state", "/mission/reference"} <= client.found.keys()
    recorded = dict(Recording(result.recording)["plant/joint_state"].messages())
    for t_ns, state in client.found["/plant/joint_state"]:
        expected = recorded[t_ns // 5_000_000].position
        assert [joint.position for joint in state.joints] == list(expected)
    frames = {t.child_frame_id for t in client.found["/tf"][-1][1].transforms}
    assert {entity.frame_id for entity in client.found["/scene"][0][1].entities} <= frames


class Clock:
    """Stands until it may go on, by 10 ms each time that it is read."""

    sleep = staticmethod(time.sleep)

    def __init__(self):
        self.now, self.goes = 0.0, False

    def monotonic(self):
        self.now += 0.01 if self.goes else 0.0
        return self.now


def test_a_recording_is_played_with_its_events_and_from_its_start_to_the_next(
    server, recording, monkeypatch
):
    clock = Clock()
    monkeypatch.setattr(foxglove_feed, "time", clock)
    end = watched(lambda is_over: play(server, Recording(recording), is_over))
    for _ in range(2):
        clock.goes = False
        client = Client(server.address).read(lambda c: "/plant/joint_state" in c.found)
        clock.goes = True
        client.read(lambda c: c.times and c.times[-1] == 490_000_000)
        client.read(lambda c: len(c.found.get("/log", ())) == 2)
        assert [(t, m.message) for t, m in client.found["/log"]] == [
            (10**7, "slow"),
            (2 * 10**7, "fast"),
        ]
        states = client.found["/plant/joint_state"]
        assert states[0][0] < 400_000_000
        assert [m.joints[0].position for _, m in states] == [t // 10**7 / 100 for t, _ in states]
        client.socket.close()
        while server.has_clients:
            time.sleep(0.01)
    end()


def picture(byte):
    return CompressedImage(data=byte * 1_000_000, format="jpeg")


def test_a_client_that_stops_reading_holds_nobody_and_gets_the_newest_later(server):
    sleeper, reader = Client(server.address), Client(server.address)
    server.publish(0, [("/picture", picture(b"0"), 0)])
    for client in (sleeper, reader):
        client.read(lambda c: c.found)
    # Far more than the buffers of its socket hold.
    for number in range(1, 100):
        server.publish(number, [("/picture", picture(b"0"), number)])
    server.publish(100, [("/picture", picture(b"1"), 100)])
    for client in (reader, sleeper):
        client.read(lambda c: c.found["/picture"][-1][0] == 100)
    assert len(sleeper.found["/picture"]) < 100
    assert sleeper.found["/picture"][-1][1].data[:1] == b"1"


def test_a_server_ends_though_a_client_does_not_read():
    server = open_server("test")
    client = Client(server.address)
    server.publish(0, [("/picture", picture(b"0"), 0)])
    client.read(lambda c: c.found)
    for number in range(1, 100):
        server.publish(number, [("/picture", picture(b"0"), number)])
    server.close()
    with pytest.raises(OSError, match="refused"):
        Client(server.address)
    # Who goes on has no server to talk to.
    server.publish(100, [("/picture", picture(b"1"), 100)])
    client.socket.close_socket()


def test_nobody_is_let_in_without_the_token_or_the_protocol(server):
    bare = server.address.rsplit("/", 2)[0]
    with pytest.raises(InvalidStatus, match="403"):
        Client(f"{bare}/guess/")
    with pytest.raises(InvalidStatus, match="400"):
        Client(server.address, "chat")
    assert not server.has_clients


@pytest.mark.parametrize(
    "text", ["no JSON", "[]", '{"op": "subscribe"}', '{"op": "subscribe", "subscriptions": [1]}',
             '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]}', "{}"],
)  # fmt: skip
def test_what_a_client_asks_wrongly_is_ignored(server, text):
    client = Client(server.address)
    client.socket.send(text)
    server.publish(0, [("/picture", picture(b"0"), 0)])
    assert client.read(lambda c: c.found).found["/picture"][0][0] == 0


def test_a_port_that_is_taken_is_one_sentence(recording, capsys):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert main(["view", str(recording), "--foxglove", str(port)]) == 2
        error = capsys.readouterr().err
    assert error.startswith(f"stepbus: port {port} of 127.0.0.1 is in use")
    assert main(["view", str(recording), "--foxglove", "--host", "192.0.2.1"]) == 2
    assert "cannot listen on 192.0.2.1" in capsys.readouterr().err


def phase(folder):
    """Return what a run says of itself; nothing before it has begun."""
    with contextlib.suppress(StepbusError):
        return stepbus.call(folder, "", "status").value["phase"]
    return ""


@pytest.mark.slow
def test_run_with_foxglove_has_its_hash_though_its_client_does_not_read(tmp_path, plain):
    words = ["run", "two_link", "--set", "duration=1s", "--out", tmp_path / "run", "--no-report"]
    views = ["--foxglove", "--view", "--no-open", "--pause-at", "0"]
    with subprocess.Popen(
        [*STEPBUS, *words, *views], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        addresses = [process.stderr.readline() for _ in range(2)]
        address = next(m[0] for line in addresses if (m := re.search(r"ws://\S+", line)))
        client = Client(address)
        while process.poll() is None and phase(tmp_path / "run") != "paused":
            time.sleep(0.05)
        stepbus.call(tmp_path / "run", "", "resume")
        out, error = process.communicate(timeout=120)
    client.socket.close()
    assert process.returncode == 0, error
    assert plain in out
    assert "Traceback" not in error


@pytest.mark.slow
def test_run_with_a_port_that_is_taken_does_not_start(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        words = ["run", "two_link", "--out", tmp_path / "run", "--foxglove", str(port)]
        done = subprocess.run([*STEPBUS, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(f"stepbus: port {port} of 127.0.0.1 is in use")
    assert not (tmp_path / "run").exists()
