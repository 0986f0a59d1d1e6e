"""The controller in Rust, on the bus itself, and the crate `stepbus-client` below it."""

import os
import re
import shutil
import subprocess

import numpy as np
import pytest
from support.paths import CHECKOUT
from support.tools import needs

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.conformance import conformance, select
from stepbus_tools.signals import read_tracking

EXAMPLE = CHECKOUT / "examples" / "controllers" / "rust"
CRATE = CHECKOUT / "clients" / "rust"

# A first build compiles about 290 crates: 11 minutes of processor time, half an hour when busy.
pytestmark = pytest.mark.timeout(3600)


NO_REGISTRY = re.compile(r"download of config.json failed|[Cc]ould not resolve|unable to update")


def cargo(folder, *arguments):
    """Run cargo in a folder with the example's build folder; return its output."""
    needs("cargo")
    environment = os.environ | {"CARGO_TARGET_DIR": str(EXAMPLE / "target")}
    pipes = {"capture_output": True, "text": True, "preexec_fn": lambda: os.nice(10)}
    done = subprocess.run(["cargo", *arguments], check=False, cwd=folder, env=environment, **pipes)
    if done.returncode and NO_REGISTRY.search(done.stderr):
        pytest.skip("cargo does not reach its registry")
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def run_example(out, *overrides):
    """Run a second of the example; return its result."""
    return run(load(EXAMPLE, ["duration=1s", *overrides]), Options(out=out))


def trajectory(result):
    """Return the positions of both joints, shape (steps + 1, 2), [rad]."""
    return read_tracking(Recording(result.recording)).state_of("joint1").fields["position"]


@pytest.fixture(scope="module")
def built():
    """Build the example."""
    cargo(EXAMPLE, "build", "--release")


@pytest.fixture(scope="module")
def result(built, tmp_path_factory):
    """Return the result of a second of the example."""
    return run_example(tmp_path_factory.mktemp("rust") / "out")


@pytest.mark.slow
def test_it_moves_the_arm_as_the_python_controller_does(result, tmp_path):
    python = run(load("two_link/pd", ["duration=1s"]), Options(out=tmp_path / "out"))
    assert (result.exit_code, trajectory(result).shape) == (0, (201, 2))
    assert np.abs(trajectory(result) - trajectory(python)).max() <= 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("transport", ["unix", "tcp"])
@pytest.mark.parametrize("window", [1, 64])
def test_window_and_transport_change_no_byte(result, tmp_path, transport, window):
    again = run_example(tmp_path / "out", f"window={window}", f"bus.transport={transport}")
    assert again.recording.read_bytes() == result.recording.read_bytes()
    assert again.drops == {"plant": 0, "controller": 0, "mission": 0}


@pytest.mark.slow
def test_its_recording_is_replayed_equal(result, capsys):
    arguments = ["replay", str(result.recording), "--participant", "controller"]
    assert main(arguments) == 0, capsys.readouterr()


@pytest.mark.slow
def test_it_joins_each_time_although_another_process_replies_as_well(built):
    checks = select(["wrong-replies"]) * 20
    report = conformance(load(EXAMPLE), "controller", checks=checks)
    assert [check.outcome for check in report.checks] == ["pass"] * 20


@pytest.mark.slow
def test_a_missing_parameter_is_a_fault_that_names_it(built, tmp_path):
    failed = run_example(tmp_path / "out", "controller.params={kp: 200}")
    assert (failed.exit_code, "params has no kd" in failed.reason) == (3, True)


@pytest.mark.slow
def test_another_type_of_input_is_refused_with_both_sides(built, tmp_path):
    wrong = "controller.inputs={joint_state: plant.joint_state}"
    failed = run_example(tmp_path / "out", wrong)
    assert (failed.exit_code, "reference" in failed.reason) == (3, True)


@pytest.mark.slow
def test_the_crate_passes_its_own_tests():
    outcomes = re.findall(r"test result: (\w+)\. (\d+) passed", cargo(CRATE, "test", "--release"))
    assert {outcome for outcome, _ in outcomes} == {"ok"}
    assert sum(int(passed) for _, passed in outcomes) > 10


@pytest.fixture(scope="module")
def thruster(tmp_path_factory):
    """Return a copy of examples/thruster with its controller in Rust."""
    cargo(CRATE, "build", "--release", "--example", "thruster")
    copy = tmp_path_factory.mktemp("thruster") / "thruster"
    shutil.copytree(CHECKOUT / "examples/thruster", copy)
    shutil.copy(EXAMPLE / "target/release/examples/thruster", copy / "controller")
    text = (copy / "scenario.yaml").read_text()
    bridge = "    bridge: {format: raw, describe: {thruster: {names: [left, right]}}}\n"
    assert bridge in text
    (copy / "scenario.yaml").write_text(text.replace(bridge, ""))
    return copy


@pytest.mark.slow
def test_types_of_its_own_go_through_it(thruster, tmp_path):
    result = run(load(thruster, ["duration=1s"]), Options(out=tmp_path / "out"))
    assert (result.exit_code, result.steps) == (0, 50), result.reason
    with Recording(result.recording) as recording:
        assert recording["controller/thruster"].thrust.shape == (50, 2)


@pytest.mark.slow
def test_types_that_the_scenario_declares_otherwise_are_refused(thruster, tmp_path):
    copy = shutil.copytree(thruster, tmp_path / "copy")
    types = (copy / "types.yaml").read_text()
    (copy / "types.yaml").write_text(types.replace("unit: N", "unit: kN"))
    vehicle = (copy / "vehicle.py").read_text()
    (copy / "old.yaml").write_text(types.replace("unit: N", "unit: kN"))
    (copy / "vehicle.py").write_text(vehicle.replace("types.yaml", "old.yaml"))
    result = run(load(copy, ["duration=1s"]), Options(out=tmp_path / "out"))
    assert result.exit_code == ExitCode.START
    assert 'unit "kN" in the scenario' in result.reason


def test_without_a_ticket_it_says_so():
    program = EXAMPLE / "target" / "release" / "two-link-pd"
    if not program.exists():
        pytest.skip("the example is not built; cargo build --release builds it")
    environment = {key: text for key, text in os.environ.items() if key != "STEPBUS_TICKET"}
    pipes = {"capture_output": True, "text": True, "timeout": 10}
    done = subprocess.run([program], check=False, env=environment, **pipes)
    assert (done.returncode, "STEPBUS_TICKET is not set" in done.stderr) == (2, True)
