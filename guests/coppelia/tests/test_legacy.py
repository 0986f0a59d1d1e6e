"""The legacy remote API, by hand-written frames; a fake simulator in the same process."""

import socket
import struct

import pytest
from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.legacy.server import LegacyEndpoint

ONESHOT, BLOCKING, STREAM, SPLIT, DISCONTINUE = 0, 1, 2, 3, 5
SYNC, NO_SYNC, TRIGGER, ERRORS, FINISH = 1, 2, 3, 4, 10
GET_JOINT, RUN_STATE, SET_FORCE, IMAGE, INT_PARAM = 0x1001, 0x1007, 0x100E, 0x1004, 0x1021
CHILD, VISION, COLLISION, READ_COLLISION = 0x200B, 0x1011, 0x300A, 0x1026
POSITION, SET_POSITION, GROUP, HANDLE = 0x200E, 0x101B, 0x200C, 0x3001
GET_SIGNAL, SET_SIGNAL, SCRIPT, DIALOG = 0x3012, 0x3015, 0x3401, 0x300C
RUNS, ENDS, PAUSED = 17, 0, 8


class Simulator:
    """Joints 1 and 2, whose position is the time; starts and stops when the test says so."""

    dt = 0.005

    def __init__(self):
        self.time, self.state, self.clients = 0.0, 0, []
        self.calls, self.left, self.signals = [], [], {}
        self.recorded = []
        self.later = False

    def join(self, client):
        self.clients.append(client)

    def leave(self, client, why):
        self.clients.remove(client)
        self.left.append(f"{client.name} {why}")

    def step(self, endpoint):
        self.time += self.dt
        endpoint.stepped()

    def call(self, client, function, args):
        self.calls.append((function, list(args)))
        self.recorded += [function] * client.is_recorded
        for known in (self.objects, self.others, self.sensors):
            if (result := known(function, list(args))) is not None:
                return result
        raise ApiError(f"no {function}{args}")

    def others(self, function, args):
        match function, args:
            case "startSimulation" | "stopSimulation", []:
                if not self.later:
                    self.state = RUNS if function == "startSimulation" else 0
                return []
            case "getInt32Param", [_]:
                return [40600]
            case "getBufferSignal", [name]:
                return [self.signals.get(name)]
            case "setStringSignal", [name, value]:
                self.signals[name] = value
                return []
            case "setJointTargetForce" | "setObjectPosition", _:
                return []
            case "callScriptFunction", [name, where, ints, floats, texts, raw]:
                return [[where, *ints], floats, [*texts, name], raw]
        return None

    def sensors(self, function, args):
        match function, args:
            case "readVisionSensor", [_]:
                return [0, [0.5, 1.0], []]
            case "getCollisionHandle", ["Collision"]:
                return [7]
            case "readCollision", [7]:
                return [1]
            case "getObjectChild", [_, index]:
                return [index or -1]
        return None

    def objects(self, function, args):
        match function, args:
            case "getJointPosition", [1 | 2]:
                return [self.time]
            case "getObject", ["/joint1"]:
                return [1]
            case "getObject", ["/joint", {"index": 2}]:
                return [3]
            case "getObjectsInTree", [-12, kind, 0]:
                return [[1, 2] if kind == 1 else [1, 2, 3]]
            case "getObjectPosition", [handle, to]:
                return [[handle, 0.5, to]]
            case "getObjectAlias", [handle]:
                return [f"o{handle}"]
            case "getObjectType", [handle]:
                return [1 if handle < 3 else 5]
            case "readProximitySensor", [_]:
                return [1, 0.5, [1.0, 2.0, 3.0], 2, None]
            case "getVisionSensorImg", [_, grey]:
                return [bytes(1 << 20 if not grey else 12), [2, 2]]
        return None


class Script:
    """A client as extApi.c is one: it asks, and reads one answer to each message."""

    def __init__(self, endpoint):
        self.endpoint = endpoint
        self.link = socket.create_connection(("127.0.0.1", endpoint.port))
        self.link.settimeout(5.0)
        self.number = 0
        self.kept = {}
        self.serve()

    def serve(self):
        for link in self.endpoint.sockets():
            self.endpoint.receive(link)

    def write(self, *commands, chunk=1294):
        """Send commands: number, mode, name, data, period."""
        body = struct.pack("<HBiiiHB", 0, 11, self.number, 77, 0, 0, 0) + b"".join(commands)
        self.number += 1
        chunks = [body[at : at + chunk] for at in range(0, len(body), chunk)]
        for left, part in zip(reversed(range(len(chunks))), chunks, strict=True):
            self.link.sendall(struct.pack("<HHH", 1, len(part), left) + part)
            self.serve()

    def read(self):
        """Return the state bits, and by number the failure, time [ms] and data of what came."""
        body, left = b"", 1
        while left:
            one, size, left = struct.unpack("<HHH", self.take(6))
            assert one == 1
            assert size < 1 << 15
            body += self.take(size)
        head = struct.unpack_from("<HBiiiHB", body)
        assert (head[2], head[3]) == (self.number - 1, 77)
        at, answers = 18, {}
        while at < len(body):
            size, whole, named, _, code, _, time, failed, _ = struct.unpack_from(
                "<iiHiiHiBB", body, at
            )
            assert size == whole
            answers[code & 0xFFFF] = failed, time, body[at + 26 + named : at + size]
            at += size
        self.kept.update(answers)
        return head[6], answers

    def take(self, size):
        data = b""
        while len(data) < size:
            self.serve()
            data += self.link.recv(size - len(data))
        return data

    def ask(self, *commands):
        self.write(*commands)
        return self.read()[1]


def cmd(number, mode=BLOCKING, name=b"", data=b"", period=0, whole=None, place=0, named=None):
    size = 26 + len(name) + len(data)
    named = len(name) if named is None else named
    head = struct.pack(
        "<iiHiiHiBB", size, whole or size, named, place, number | mode << 16, period, 0, 0, 0
    )
    return head + name + data


def handle(*numbers):
    return struct.pack(f"<{len(numbers)}i", *numbers)


@pytest.fixture
def sim():
    return Simulator()


@pytest.fixture
def endpoint(sim):
    endpoint = LegacyEndpoint(sim, 0)
    yield endpoint
    endpoint.close()


@pytest.fixture
def connect(endpoint):
    scripts = []

    def more():
        scripts.append(Script(endpoint))
        return scripts[-1]

    yield more
    for script in scripts:
        script.link.close()


@pytest.fixture
def script(connect):
    return connect()


def value(answer, form="<f"):
    return struct.unpack_from(form, answer[2])[0]


def test_answers_several_commands_at_once(sim, script):
    answers = script.ask(cmd(GET_JOINT, name=handle(1)), cmd(INT_PARAM, name=handle(12)))
    assert answers == {GET_JOINT: (0, 0, bytes(4)), INT_PARAM: (0, 0, handle(40600))}
    assert sim.clients[0].name == "client 1 (legacy)"


def test_an_empty_message_is_answered(script):
    assert script.ask() == {}


@pytest.mark.parametrize(
    ("name", "found"), [(b"joint1\0", 1), (b"/joint1\0", 1), (b"joint#1\0", 3), (b"joint1#\0", 1)]
)
def test_names_of_old(script, name, found):
    assert script.ask(cmd(HANDLE, name=name))[HANDLE] == (0, 0, handle(found))


def test_a_failure_sets_the_flag_and_is_told(sim, script):
    answers = script.ask(cmd(GET_JOINT, name=handle(9)), cmd(DIALOG, name=b"t\0"), cmd(0x1777))
    assert [row[0] for row in answers.values()] == [1, 1, 1]
    assert ("simxDisplayDialog", []) in sim.calls
    errors = script.ask(cmd(ERRORS))[ERRORS][2]
    assert struct.unpack_from("<i", errors) == (3,)
    assert b"simxDisplayDialog" in errors
    assert script.ask(cmd(ERRORS))[ERRORS][2] == handle(0)


def test_data_that_is_too_short_fails_alone(sim, script):
    assert script.ask(cmd(SET_POSITION, name=handle(1), data=b"abc"))[SET_POSITION][0] == 1
    assert script.ask(cmd(HANDLE, name=b"no end"))[HANDLE][0] == 1
    assert script.ask(cmd(SCRIPT, name=b"abc"))[SCRIPT][0] == 1
    counts = struct.pack("<4i", 2**31 - 1, -5, 2**31 - 1, 7)
    assert script.ask(cmd(SCRIPT, name=handle(1) + b"a\0b\0", data=counts))[SCRIPT][0] == 1
    assert sim.clients


def test_arguments_come_in_the_order_of_the_new_api(sim, script):
    data = handle(-1) + struct.pack("<3f", 1, 2, 3)
    script.ask(cmd(SET_POSITION, name=handle(7), data=data))
    script.ask(cmd(SET_FORCE, name=handle(1), data=struct.pack("<f", 2.5)))
    assert sim.calls[-2:] == [
        ("setObjectPosition", [7, [1.0, 2.0, 3.0], -1]),
        ("setJointTargetForce", [1, 2.5, False]),
    ]


def test_calls_a_script_function(script):
    data = struct.pack("<4i2if", 2, 1, 1, 3, 5, 6, 0.5) + b"text\0" + b"\1\0\2"
    (failed, _, answer) = script.ask(cmd(SCRIPT, name=handle(1) + b"robot\0f\0", data=data))[SCRIPT]
    assert not failed
    assert answer == struct.pack("<4i3if", 3, 1, 2, 3, 1, 5, 6, 0.5) + b"text\0f@robot\0\1\0\2"


def test_data_of_groups(script):
    assert (
        script.ask(cmd(GROUP, name=handle(1, 0)))[GROUP][2]
        == handle(2, 0, 0, 2, 1, 2) + b"o1\0o2\0"
    )
    positions = script.ask(cmd(GROUP, name=handle(1, 4)))[GROUP][2]
    assert positions == handle(2, 0, 6, 0, 1, 2) + struct.pack("<6f", 1, 0.5, -11, 2, 0.5, -11)
    sensors = script.ask(cmd(GROUP, name=handle(109, 13)))[GROUP][2]
    assert sensors[:52] == handle(3, 6, 18, 0, 1, 2, 3, -1, -1, -1, -1, 1, 2)
    assert script.ask(cmd(GROUP, name=handle(1, 99)))[GROUP][0] == 1


def test_collision_objects(script):
    assert script.ask(cmd(COLLISION, name=b"Collision\0"))[COLLISION] == (0, 0, handle(7))
    assert script.ask(cmd(READ_COLLISION, name=handle(7)))[READ_COLLISION] == (0, 0, handle(1))
    assert script.ask(cmd(COLLISION, name=b"other\0"))[COLLISION][0] == 1
    assert script.ask(cmd(READ_COLLISION, name=handle(1)))[READ_COLLISION][0] == 1


def test_vision_sensors_and_children(script):
    packets = b"\0" + handle(1, 2) + struct.pack("<2f", 0.5, 1.0)
    assert script.ask(cmd(VISION, name=handle(3)))[VISION] == (0, 0, packets)
    assert script.ask(cmd(CHILD, name=handle(1, 0)))[CHILD] == (0, 0, handle(-1))


# --- modes -----------------------------------------------------------------------------------


def test_a_stream_is_sent_with_every_answer_until_discontinued(sim, endpoint, script):
    sim.state = RUNS
    assert value(script.ask(cmd(GET_JOINT, STREAM, handle(1)))[GET_JOINT]) == 0.0
    sim.step(endpoint)
    assert script.ask()[GET_JOINT] == (0, 5, struct.pack("<f", 0.005))
    assert script.ask(cmd(GET_JOINT, DISCONTINUE, handle(1)))[GET_JOINT] == (0, 5, b"")
    assert script.ask() == {}


def test_a_stream_with_a_period_goes_by_simulation_time(sim, endpoint, script):
    sim.state = RUNS
    script.ask(cmd(GET_JOINT, STREAM, handle(1), period=15))
    seen = []
    for _ in range(6):
        sim.step(endpoint)
        seen.append(GET_JOINT in script.ask())
    assert seen == [False, False, True] * 2


def test_a_stream_is_recorded_once_and_other_calls_always(sim, endpoint, script):
    script.ask(cmd(GET_JOINT, STREAM, handle(1)))
    for _ in range(3):
        script.ask(cmd(INT_PARAM, name=handle(12)))
    assert sim.calls[0] == sim.calls[-1] == ("getJointPosition", [1])
    assert sim.recorded == ["getJointPosition"] + ["getInt32Param"] * 3


def test_a_heavy_stream_is_sent_once_per_step(sim, endpoint, script):
    sim.state = RUNS
    assert len(script.ask(cmd(IMAGE, STREAM, handle(3)))[IMAGE][2]) == 8 + (1 << 20)
    assert script.ask() == {}
    sim.step(endpoint)
    assert IMAGE in script.ask()


def test_a_single_read_ends_the_stream_of_the_same(script):
    script.ask(cmd(GET_JOINT, STREAM, handle(1)), cmd(GET_JOINT, STREAM, handle(2)))
    script.ask(cmd(GET_JOINT, BLOCKING, handle(1)))
    assert len(script.ask()) == 1


def test_a_command_in_parts(sim, script):
    name, data = b"s\0", bytes(range(250))
    for place in (0, 100, 200):
        part = data[place : place + 100]
        script.write(cmd(SET_SIGNAL, SPLIT, name, part, 100, 26 + len(name) + len(data), place))
        script.read()
        assert ("s" in sim.signals) == (place == 200)
    assert sim.signals["s"] == data


def test_a_message_in_packets_and_a_long_answer(sim, script):
    data = bytes(range(256)) * 400
    script.ask(cmd(SET_SIGNAL, name=b"s\0", data=data))
    assert script.ask(cmd(GET_SIGNAL, name=b"s\0"))[GET_SIGNAL][2] == data


# --- steps -----------------------------------------------------------------------------------


def is_answered(script):
    script.serve()
    script.link.setblocking(False)
    try:
        return bool(script.link.recv(1, socket.MSG_PEEK))
    except BlockingIOError:
        return False
    finally:
        script.link.settimeout(5.0)


def test_a_trigger_is_answered_after_its_step_with_its_values(sim, endpoint, script):
    script.ask(cmd(SYNC), cmd(RUN_STATE, name=handle(0)), cmd(GET_JOINT, STREAM, handle(1)))
    client = sim.clients[0]
    assert (client.level, client.waits) == (1, False)
    script.write(cmd(TRIGGER), cmd(SET_FORCE, ONESHOT, handle(1), struct.pack("<f", 1.0)))
    assert client.waits
    assert sim.calls[-1][0] == "setJointTargetForce"
    script.link.sendall(b"\1\0")
    assert not is_answered(script)
    sim.step(endpoint)
    assert not client.waits
    state, answers = script.read()
    assert state == 1
    assert answers[TRIGGER] == (0, 5, b"")
    assert value(answers[GET_JOINT]) == pytest.approx(0.005)


def test_a_trigger_fails_where_nothing_is_stepped(sim, script):
    sim.state = RUNS
    assert script.ask(cmd(TRIGGER))[TRIGGER][0] == 1
    script.ask(cmd(SYNC))
    for sim.state in (ENDS, PAUSED):
        assert script.ask(cmd(TRIGGER))[TRIGGER][0] == 1
    script.ask(cmd(NO_SYNC))
    assert sim.clients[0].level == 0


def test_start_and_stop_are_answered_when_done(sim, endpoint, script):
    sim.later = True
    for which, state in ((0, RUNS), (2, ENDS)):
        script.write(cmd(RUN_STATE, name=handle(which)))
        assert not is_answered(script)
        sim.state = state
        endpoint.stepped()
        assert script.read()[0] == bool(state)


def test_who_waits_is_answered_when_the_simulation_stops(sim, endpoint, script):
    sim.state = RUNS
    script.ask(cmd(SYNC))
    script.write(cmd(TRIGGER))
    sim.state, sim.time = ENDS, 0.0
    endpoint.stepped()
    assert script.read() == (0, {TRIGGER: (0, 0, b"")})


def test_who_waits_and_goes_has_left(sim, endpoint, script):
    sim.state = RUNS
    script.ask(cmd(SYNC))
    script.write(cmd(TRIGGER))
    script.link.close()
    script.serve()
    assert not sim.clients
    assert "has closed its connection" in sim.left[0]


# --- who breaks the rules ----------------------------------------------------------------------


def test_finish_leaves_once_and_is_still_answered(sim, script):
    script.ask(cmd(GET_JOINT, STREAM, handle(1)))
    assert script.ask(cmd(FINISH, ONESHOT)) == {}
    assert not sim.clients
    calls = len(sim.calls)
    assert script.ask(cmd(GET_JOINT, name=handle(1))) == {}
    assert len(sim.calls) == calls
    script.link.close()
    script.serve()
    assert [text.partition(") ")[2] for text in sim.left] == ["has finished"]


HEADER = struct.pack("<HBiiiHB", 0, 11, 0, 0, 0, 0, 0)


def packet(body, left=0):
    return struct.pack("<HHH", 1, len(body), left) + body


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"GET / HTTP/1.1\r\n", "starts with"),
        (struct.pack(">HHH", 1, 0, 0), "starts with 256"),
        (packet(b""), "message of 0 bytes"),
        (packet(HEADER + b"abc"), "command of 3 bytes"),
        (packet(HEADER + cmd(GET_JOINT, name=handle(1), named=99)), "99 its name"),
        (packet(HEADER + cmd(GET_JOINT, whole=2**31 - 1)), f"of {2**31 - 1} bytes"),
        (packet(HEADER + cmd(GET_JOINT, whole=1)), "of 1 bytes"),
        (packet(HEADER + struct.pack("<iiHiiHiBB", 0, 0, 0, 0, 1, 0, 0, 0, 0)), "of 0 of 0"),
        (packet(HEADER + struct.pack("<iiHiiHiBB", -5, -5, 0, 0, 1, 0, 0, 0, 0)), "of -5"),
        (
            packet(HEADER, 1) + packet(cmd(NO_SYNC) * 1000, 1) * 4 + packet(cmd(NO_SYNC) * 97),
            "4096 c",
        ),
        (
            packet(HEADER + b"".join(cmd(1, whole=99, name=b"%4d" % n) for n in range(70))),
            "incomplete",
        ),
        (packet(HEADER + b"".join(cmd(IMAGE, name=handle(n)) for n in range(70))), "asks for more"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_who_breaks_the_rules_is_dropped_alone(sim, connect, script, data, why):
    other = connect()
    for at in range(0, len(data), 30000):
        script.link.sendall(data[at : at + 30000])
        script.serve()
    script.serve()
    assert len(sim.clients) == 1
    assert why in sim.left[0]
    assert value(other.ask(cmd(GET_JOINT, name=handle(1)))[GET_JOINT]) == 0.0


def test_too_many_streams(sim, script):
    for n in range(0, 5000, 1000):
        script.write(*(cmd(GET_JOINT, STREAM, handle(m)) for m in range(n, n + 1000)))
        if sim.clients:
            script.read()
    assert "streams more than 4096" in sim.left[0]


@pytest.mark.parametrize("size", [1, 5, 7, 20, 40])
def test_half_a_frame_stops_nobody(sim, connect, script, size):
    whole = packet(HEADER + cmd(GET_JOINT, name=handle(1)))
    script.link.sendall(whole[:size])
    script.serve()
    other = connect()
    assert GET_JOINT in other.ask(cmd(GET_JOINT, name=handle(1)))
    script.link.sendall(whole[size:])
    script.serve()
    assert struct.unpack("<HHH", script.take(6))[0] == 1
    assert len(sim.clients) == 2


def test_a_client_that_does_not_read_stops_nobody(sim, connect, script):
    other = connect()
    image = packet(HEADER + cmd(IMAGE, name=handle(1)))
    script.link.setblocking(False)
    for _ in range(200):
        try:
            script.link.send(image)
        except BlockingIOError:
            break
        script.serve()
    slow = sim.clients[0]
    assert 0 < len(slow.out) < 3 << 20
    assert GET_JOINT in other.ask(cmd(GET_JOINT, name=handle(1)))
    # It then reads after all.
    script.link.settimeout(5.0)
    served = sim.calls.count(("getVisionSensorImg", [1, 0]))
    script.take(served * (1 << 20))
    assert len(sim.clients) == 2


def test_a_reset_connection(sim, script):
    script.link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    script.link.close()
    script.serve()
    assert not sim.clients
    assert "lost its connection" in sim.left[0]


def test_port_is_of_this_machine_and_is_freed(sim, endpoint):
    with pytest.raises(OSError, match="in use"):
        LegacyEndpoint(sim, endpoint.port)
    endpoint.close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", endpoint.port), 1.0)
