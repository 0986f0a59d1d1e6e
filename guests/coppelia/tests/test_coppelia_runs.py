"""`stepbus coppelia`: whole sessions of a script, by a client of our own in another process."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import mini
import pytest
from mcap.reader import make_reader

from stepbus import Recording

SCRIPT = """
import mini
sim = mini.Client()
joints = [sim.getObject(path) for path in ("/arm/joint1", "/joint2")]
"""
STEPS = """
sim.setStepping(True)
sim.startSimulation()
while sim.getSimulationTime() < 0.2:
    for joint, goal in zip(joints, (0.3, 1.0)):
        sim.setJointTargetForce(joint, 30 * (goal - sim.getJointPosition(joint)))
    sim.step()
print("at", sim.getJointPosition(joints[0]), flush=True)
sim.stopSimulation()
"""


@pytest.fixture
def start(tmp_path):
    """Start `stepbus coppelia two_link` with a script; all that it starts is ended."""
    shutil.copy(mini.__file__, tmp_path)
    started = []

    def begin(text, *options, scenario="two_link"):
        script = ()
        if text is not None:
            (tmp_path / "script.py").write_text(text)
            script = ("--", "python", "script.py")
        ports = () if "--port" in options else ("--port", "0", "--legacy-port", "0")
        words = ["coppelia", scenario, *ports, "--no-report", *options, *script]
        process = subprocess.Popen(
            [str(Path(sys.executable).with_name("stepbus")), *words],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        started.append(process)
        return process

    yield begin
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def end(process, code=0):
    out, err = process.communicate(timeout=100)
    assert process.returncode == code, out + err
    assert "Traceback" not in out + err
    return out, err


def stepbus(folder, *words, code=0):
    command = [str(Path(sys.executable).with_name("stepbus")), *words]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


def test_a_script_is_recorded_repeated_and_branched(start, tmp_path):
    end(start(SCRIPT + STEPS, "--out", "one"))
    out, _ = end(start(SCRIPT + STEPS, "--out", "two"))
    assert "finished (script: sim.stopSimulation) after 41 steps of 5 ms" in out
    one, two = ((tmp_path / name / "run.mcap").read_bytes() for name in ("one", "two"))
    assert one == two
    # What the script saw is what the log shows, read by code that is none of ours.
    with (tmp_path / "one" / "run.mcap").open("rb") as stream:
        topics = {c.topic for _, c, _ in make_reader(stream).iter_messages()}
    assert {"script/command", "script/calls", "plant/joint_state"} <= topics
    states = list(Recording(tmp_path / "one").messages("plant/joint_state"))
    assert f"at {states[40][1].position[0]}" in out
    assert "byte for byte" in stepbus(tmp_path, "rerun", "one", "--out", "again", "--trust")
    assert "plant: equal" in stepbus(tmp_path, "replay", "one", "--participant", "plant")
    # Another gain, from step 20 on.
    (tmp_path / "other.py").write_text((SCRIPT + STEPS).replace("30 *", "90 *"))
    other = ("--set", "script.params.command=[python, other.py]", "--trust", "--no-report")
    text = stepbus(tmp_path, "branch", "one", "--at", "20", *other, "--out", "branched")
    assert "live from step 20" in text
    assert "diverges from the recording at step 20: script/command" in text


def test_joints_that_the_scenario_does_not_measure_are_seen(start):
    text = """
import mini
sim = mini.Client()
fingers = [sim.getObject(f"/arm/{side}_finger") for side in ("left", "right")]
sim.setStepping(True)
sim.startSimulation()
for finger in fingers:
    sim.setJointTargetVelocity(finger, -0.1)
for step in range(20):
    sim.step()
assert [sim.getJointPosition(finger) < 0.03 for finger in fingers] == [True, True]
sim.stopSimulation()
"""
    end(start(text, scenario="pick"))


def test_a_simulation_may_start_with_the_script(start):
    text = SCRIPT + "while sim.getSimulationTime() < 0.1: pass\nsim.stopSimulation()"
    out, _ = end(start(text, "--start"))
    assert "finished (script: sim.stopSimulation)" in out


def test_bodies_that_move_are_where_the_plant_says(start, tmp_path):
    (tmp_path / "ball.urdf").write_text(
        '<robot name="b"><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"'
        ' ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
    )
    (tmp_path / "world.yaml").write_text("bodies: {Ball: {urdf: ball.urdf, position: [0, 0, 9]}}")
    (tmp_path / "fall.yaml").write_text(
        "{name: fall, step: 50ms, duration: 1s, participants: {plant: {participant: "
        '"stepbus_plant:Plant", publishes: first, params: {world: world.yaml}}}}'
    )
    text = """
import mini
sim = mini.Client()
ball = sim.getObject("/Ball")
sim.setStepping(True)
sim.startSimulation()
for _ in range(10): sim.step()
print("fell", 9 - sim.getObjectPosition(ball)[2])
sim.stopSimulation()
"""
    out, _ = end(start(text, scenario="fall.yaml"))
    assert 1.2 < float(out.partition("fell ")[2].split()[0]) < 1.4


def test_a_second_simulation_is_a_run_of_its_own(start, tmp_path):
    out, _ = end(start(SCRIPT + STEPS + STEPS, "--out", "runs"))
    assert out.count("sim.stopSimulation) after 41 steps") == 2
    first, second = (Recording(tmp_path / name) for name in ("runs", "runs-2"))
    names = [list(r.messages("plant/joint_state")) for r in (first, second)]
    assert names[0] == names[1]


def test_shapes_of_a_script_are_bodies_and_leave_no_files(start, tmp_path, monkeypatch):
    # Sockets are in there, too, so its name is short.
    scratch = tempfile.TemporaryDirectory()
    monkeypatch.setenv("TMPDIR", scratch.name)
    cube = "cube = sim.createPureShape(0, 8, [0.1, 0.1, 0.1], 1)\n"
    cube += "sim.setObjectPosition(cube, [0, 0.5, 2])\n"
    seen = "print('z', sim.getObjectPosition(cube)[2], flush=True)\nsim.stopSimulation()"
    out, _ = end(start(SCRIPT + cube + STEPS.replace("sim.stopSimulation()", seen), "--out", "one"))
    # It has fallen for 0.2 s.
    assert float(out.split("z ")[1].split()[0]) == pytest.approx(2 - 9.81 * 0.2**2 / 2, abs=0.01)
    assert "byte for byte" in stepbus(tmp_path, "rerun", "one", "--out", "again", "--trust")
    assert list(Path(scratch.name).iterdir()) == []
    scratch.cleanup()


def test_without_stepping_it_keeps_to_the_clock(start):
    text = SCRIPT + (
        "import time\nsim.startSimulation()\nbegun = time.monotonic()\n"
        "while sim.getSimulationTime() < 0.5: pass\n"
        "print('took', time.monotonic() - begun, flush=True)\nsim.stopSimulation()\n"
    )
    out, _ = end(start(text))
    assert float(out.split("took ")[1].split()[0]) > 0.45


def test_protocol_1_waits_for_the_number_of_the_step(start):
    text = """
import mini, zmq, cbor2, os
sim = mini.Client(version=1)
joint = sim.getObject("/joint1")
assert sim.call("setStepping", True, "id") == 0
sim.startSimulation()
for step in range(5):
    sim.call("step", "id")
    while sim.getSimulationTime() < 0.005 * (step + 1) - 1e-9:
        pass
try:
    sim.getObject("/nothing")
except mini.RemoteError as exc:
    print("said", exc, flush=True)
sim.stopSimulation()
sim.socket.send(cbor2.dumps({"func": "_*end*_", "args": []}))
assert cbor2.loads(sim.socket.recv()) == {}
"""
    out, _ = end(start(text))
    assert "said in sim.getObject: object does not exist" in out
    assert "after 6 steps" in out


@pytest.mark.parametrize(
    ("text", "code", "says"),
    [
        ("raise SystemExit(3)", 4, "the script has ended with exit code 3"),
        ("", 4, "has not started a simulation"),
        (SCRIPT + "sim.setStepping(True)\nsim.startSimulation()\nsim.step()\nraise SystemExit(3)", 4,
         "step 1 (t = 0.005 s): script"),
        (SCRIPT + "import os\nsim.setStepping(True)\nsim.startSimulation()\nsim.step()\nos.kill(os.getpid(), 9)",
         4, "the script has ended with signal 9; see its output"),
        (SCRIPT + "import time\nsim.setStepping(True)\nsim.startSimulation()\nsim.step()\ntime.sleep(60)", 4,
         "client 1 (ZeroMQ) steps the simulation, and has not asked for a step for 1 s"),
    ],
    ids=["before", "nothing", "in the midst", "killed", "silent"],
)  # fmt: skip
def test_a_script_that_fails_is_named(start, text, code, says):
    process = start(text, "--client-timeout", "1s")
    out, err = end(process, code)
    assert says in " ".join((out + err).split())


def test_ctrl_c_ends_it(start):
    process = start(
        SCRIPT + "sim.startSimulation()\nprint('runs', flush=True)\nimport time\ntime.sleep(90)"
    )
    assert process.stdout.readline().startswith("runs")
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, out + err
    assert (
        "Traceback" not in err.replace('Traceback (most recent call last):\n  File "/', "", 0)
        or "KeyboardInterrupt" in err
    )


def test_a_client_from_elsewhere_and_nonsense(start):
    process = start(None)
    port = int(process.stderr.readline().split(":")[1].split(";")[0])
    with socket.create_connection(("127.0.0.1", port)) as link:
        link.sendall(b"GET / HTTP/1.1\r\n\r\n")
    with socket.create_connection(("127.0.0.1", port)) as link:
        # Which is a message of ZeroMQ's first protocol: of no name, and `abc`.
        link.sendall(b"\x01\x00\x04\x00abc")
    context = mini.zmq.Context()
    raw = context.socket(mini.zmq.REQ)
    raw.setsockopt(mini.zmq.LINGER, 0)
    raw.connect(f"tcp://127.0.0.1:{port}")
    for data in (b"", b"\xff" * 20, mini.cbor2.dumps([1]), mini.cbor2.dumps({"func": 1})):
        raw.send(data)
        assert "err" in mini.cbor2.loads(raw.recv())
    one, two = mini.Client(port), mini.Client(port)
    with pytest.raises(mini.RemoteError, match="plugin 'simOMPL' is not available"):
        one.call("zmqRemoteApi.require", "simOMPL")
    assert {"getObject", "moveToConfig", "simulation_stopped"} <= one.call(
        "zmqRemoteApi.info", "sim"
    ).keys()
    with pytest.raises(mini.RemoteError, match="not available in stepbus"):
        one.eval("x")
    with pytest.raises(mini.RemoteError, match=r"in sim.moveToConfig: this function is not"):
        one.moveToConfig({})
    one.socket.send(mini.cbor2.dumps({"func": "sim.step", "args": [], "uuid": "x", "ver": 3}))
    assert "speaks version 2, the client 3" in mini.cbor2.loads(one.socket.recv())["err"]
    two.setStepping(True)
    one.startSimulation()
    for number in range(3):
        two.step()
        assert one.getSimulationTime() == pytest.approx(0.005 * (number + 1))
    raw.close()
    context.term()
    two.close()
    one.close()
    out, err = end(process)
    assert re.search(r"finished \(script: client \d \(ZeroMQ\) has left\)", out)
    assert "sim.eval, 1×" in err


def test_a_port_that_is_taken_is_named(start, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        _, err = end(start("", "--port", str(port), "--legacy-port", "0"), 2)
    assert f"cannot listen on port {port}" in err
    assert "--port" in err
