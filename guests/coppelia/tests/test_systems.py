"""The scripts of `examples/coppelia/systems`, with the clients of V-REP and CoppeliaSim."""

import os
import runpy
import shutil
import signal
import socket
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from stepbus import Recording

SYSTEMS = Path(__file__).parents[3] / "examples/coppelia/systems"
ARM = "two_link/velocity_force"
LEGACY = pytest.mark.skipif(
    find_spec("guira") is None, reason="needs guira==0.1.0, without its dependencies"
)
OCTAVE = pytest.mark.skipif(
    not shutil.which("octave-cli")
    or not any((Path(f) / "remApi.oct").is_file() for f in os.getenv("OCTAVE_PATH", "").split(":")),
    reason="needs octave-cli, and remApi.oct in a folder of OCTAVE_PATH",
)
ZMQ = pytest.mark.skipif(
    find_spec("coppeliasim_zmqremoteapi_client") is None,
    reason="needs coppeliasim-zmqremoteapi-client==2.0.4",
)
BAXTER = pytest.mark.skipif(
    find_spec("stepbus_store") is None or find_spec("xacro") is None, reason="needs `make robots`"
)

TOUCH = """
from guira import sim
B, S, BUFFER = sim.simx_opmode_blocking, sim.simx_opmode_streaming, sim.simx_opmode_buffer
client = sim.simxStart("127.0.0.1", 19997, True, True, 5000, 1)
print("unknown", *sim.simxGetCollisionHandle(client, "Colision", B))
_, handle = sim.simxGetCollisionHandle(client, "Collision", B)
_, gripper = sim.simxGetObjectHandle(client, "gripper", B)
_, cube = sim.simxGetObjectHandle(client, "Cuboid1", B)
print("child", sim.simxGetObjectChild(client, gripper, 0, B)[0])
data = bytes(range(256)) * 40
sim.simxSynchronous(client, True)
sim.simxStartSimulation(client, B)
sim.simxReadCollision(client, handle, S)
sim.simxSetStringSignal(client, "s", data, sim.simx_opmode_oneshot_split + 1000)
for step in range(20):
    sim.simxSynchronousTrigger(client)
    sim.simxGetPingTime(client)
    if step in (10, 11):
        print("collision", *sim.simxReadCollision(client, handle, BUFFER))
        sim.simxSetObjectPosition(client, cube, gripper, (0, -0.05, -0.06), B)
print("parts", bytes(sim.simxGetStringSignal(client, "s", B)[1]) == data)
sim.simxStopSimulation(client, B)
sim.simxFinish(client)
"""


class Bench:
    """Runs stepbus in a folder, with copies of the scripts that call at free ports."""

    def __init__(self, folder):
        self.folder = folder
        with socket.create_server(("127.0.0.1", 0)) as one, socket.create_server(("", 0)) as two:
            zmq, legacy = (str(server.getsockname()[1]) for server in (one, two))
        self.ports = ("--port", zmq, "--legacy-port", legacy)
        for script in [*SYSTEMS.glob("*.py"), *SYSTEMS.glob("*.m")]:
            text = script.read_text().replace("19997", legacy)
            text = text.replace("RemoteAPIClient()", f"RemoteAPIClient(port={zmq})")
            (folder / script.name).write_text(text)

    def start(self, *words):
        return subprocess.Popen(
            [str(Path(sys.executable).with_name("stepbus")), *words],
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def run(self, *words, code=0):
        process = self.start(*words)
        out, _ = process.communicate(timeout=200)
        assert process.returncode == code, out
        return out

    def script(self, scenario, out, *script, code=0):
        words = ("coppelia", *scenario.split(), *self.ports, "--no-report", "--out", out, "--")
        return self.run(*words, *script, code=code)

    def against(self, script, scenario, seen=""):
        """Run a native scenario; return its figures and those of a script's run."""
        words = ("--out", "native", "--in-process", "--no-report")
        self.run("run", *scenario.split(), *words)
        compare = runpy.run_path(str(SYSTEMS / "compare.py"))["compare"]
        return compare(self.folder / script, self.folder / "native", seen)

    def messages(self, out):
        return Recording(self.folder / out).messages_sha256

    def repeats(self, out):
        """Check that a run can be repeated, and its plant replayed."""
        assert "byte for byte" in self.run("rerun", out, "--trust", "--out", "again")
        assert "plant: equal" in self.run("replay", out, "--participant", "plant")


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


def gains_equal(figures, within):
    for name in ("RMS error of joint1", "largest error of joint1", "RMS error of joint2"):
        pair = [figures[f"{who}: {name} [rad]"] for who in ("script", "native")]
        assert pair[0] == pytest.approx(pair[1], abs=within)


@LEGACY
@pytest.mark.slow
def test_two_links_as_the_native_controller(bench):
    for out in ("one", "two"):
        bench.script(f"{ARM} --set duration=4s", out, "python", "two_link.py")
    assert bench.messages("one") == bench.messages("two")
    figures = bench.against("one", f"{SYSTEMS}/native/two_link_pd.yaml --set duration=4s")
    assert figures["largest difference of a joint [rad]"] < 1e-7
    gains_equal(figures, 1e-7)
    bench.repeats("one")
    other = 'script.params.command=[python, two_link.py, "60", "0.02", "2"]'
    words = ("--at", "2s", "--set", other, "--trust", "--no-report", "--out", "branch")
    assert "diverges from the recording at step 400" in bench.run("branch", "one", *words)


@LEGACY
@OCTAVE
@pytest.mark.slow
def test_octave_sends_what_python_does(bench):
    for out, *script in (("py", "python", "two_link.py"), ("m", "octave-cli", "two_link.m")):
        bench.script(f"{ARM} --set duration=3s", out, *script, "60", "0.02", "2")
    assert bench.messages("py") == bench.messages("m")
    figures = bench.against("m", f"{SYSTEMS}/native/two_link_pid.yaml --set duration=3s")
    assert figures["largest difference of a joint [rad]"] < 1e-5
    gains_equal(figures, 1e-5)


@LEGACY
@pytest.mark.slow
def test_a_script_that_is_killed_ends_the_run(bench):
    script = bench.folder / "two_link.py"
    script.write_text(
        script.read_text().replace(
            "while t <", "print('pid', __import__('os').getpid(), flush=True)\nwhile t <"
        )
    )
    words = ("--no-report", "--out", "out", "--", "python", "two_link.py")
    process = bench.start("coppelia", ARM, *bench.ports, *words)
    while "pid" not in (line := process.stdout.readline()):
        assert line
    os.kill(int(line.split("pid")[1]), signal.SIGKILL)
    out, _ = process.communicate(timeout=10)
    assert process.returncode == 4
    assert out.count("the script has ended with signal 9; see its output") == 1


@ZMQ
@pytest.mark.slow
def test_the_cube_is_picked_as_natively(bench):
    out = bench.script("pick", "one", "python", "pick_and_place.py")
    assert "the cube is held" in out
    bench.repeats("one")
    figures = bench.against("one", "pick")
    for who in ("script", "native"):
        assert figures[f"{who}: end of the cube [m]"] == pytest.approx([0.3, 0.2, 0.4], abs=1e-3)
        assert figures[f"{who}: held for [s]"] > 1.5
    assert figures["script: end [s]"] == pytest.approx(figures["native: end [s]"], abs=0.2)
    assert "the cube is not held" in bench.script(
        "pick", "weak", "python", "pick_and_place.py", "0.3", code=4
    )
    other = 'script.params.command=[python, pick_and_place.py, "0.3"]'
    words = ("--at", "1s", "--set", other, "--trust", "--no-report", "--out", "branch")
    bench.run("branch", "one", *words)
    assert bench.messages("branch") == bench.messages("weak")


@LEGACY
@BAXTER
@pytest.mark.slow
def test_baxter_reads_what_is_recorded(bench):
    bench.script("baxter", "one", "python", "baxter.py")
    bench.repeats("one")
    native = "baxter --set controller.params.feed_forward=false"
    figures = bench.against("one", native, str(bench.folder / "baxter.csv"))
    assert figures["angles seen and recorded are the same float32"]
    assert figures["largest difference of a joint [rad]"] < 1e-7


@LEGACY
@pytest.mark.slow
def test_the_compiled_client_reads_collisions_and_sends_in_parts(bench):
    (bench.folder / "touch.py").write_text(TOUCH.replace("19997", bench.ports[3]))
    named = 'script.params.collisions={"Collision":[/gripper,/Cuboid1]}'
    out = bench.script(f"{SYSTEMS.parent}/pick --set {named}", "one", "python", "touch.py")
    for line in ("unknown 8 0", "child 0", "collision 0 False", "collision 0 True", "parts True"):
        assert f"{line}\n" in out
    assert "collision object 'Colision': object does not exist; name its two objects" in out
