"""Each fault ends the run with one sentence, its own exit code, no orphan, a readable log."""

import re
import socket

import pytest
from mcap.reader import make_reader
from support.runs.joints import fault, run_joints, write_scenario

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.extension import RunExtension

FAST = ("controller.step_timeout=1s", "controller.stop_timeout=1s")


pytestmark = pytest.mark.usefixtures("nothing_is_left")


def recorded_steps(result):
    with result.recording.open("rb") as file:
        messages = make_reader(file).iter_messages(topics=["plant/joint_state"])
        return [message.sequence for _, _, message in messages]


@pytest.mark.parametrize(
    ("alone", "kind", "code", "sentence"),
    [
        (False, "raise", ExitCode.FAULT, r"step 7 \(t = 0\.035 s\): controller \(pid \d+\): ValueError: the knee"),
        (False, "mute", ExitCode.FAULT, r"step 7 .*: controller \(pid \d+\): Mute: \(its __str__ raised RuntimeError\)"),
        (False, "surrogate", ExitCode.FAULT, r"step 7 .*: controller \(pid \d+\): ValueError: the knee \\ud800"),
        (False, "exit", ExitCode.DIED, r"step 7 .*: controller \(pid \d+\) exited with code 3"),
        (False, "kill", ExitCode.DIED, r"step 7 .*: controller \(pid \d+\) was killed by SIGKILL"),
        (False, "hang", ExitCode.STEP_TIMEOUT, r"step 7 .*: controller \(pid \d+\) has been computing for \d+\.\d s; all inputs have arrived; deadline 1 s \(participants\.controller\.step_timeout\)"),
        (False, "stop", ExitCode.STEP_TIMEOUT, r"step 7 .*: controller \(pid \d+\) has been stopped by a signal"),
        (False, "deaf", ExitCode.STEP_TIMEOUT, r"step 7 .*: controller \(pid \d+\) has been computing"),
        (True, "raise", ExitCode.FAULT, r"step 7 \(t = 0\.035 s\): controller \(pid \d+\): ValueError: the knee"),
        (True, "leave", ExitCode.DIED, r"step 7 .*: controller \(pid \d+\) exited with code 3"),
        (True, "hang", ExitCode.STEP_TIMEOUT, r"step 7 .*: controller \(pid \d+\) has been computing for \d+\.\d s, at joints\.py:\d+ in go_wrong; deadline 1 s \(participants\.controller\.step_timeout\)"),
        (True, "port", ExitCode.FAULT, r"step 7.*the scenario has no output port 'komand'; it has command"),
        (True, "type", ExitCode.FAULT, r"step 7.*port 'command' takes JointCommand/1, got Event"),
        (True, "huge", ExitCode.FAULT, r"step 7.*exceed the bus's limit"),
    ],
)  # fmt: skip
def test_a_fault_in_a_step_is_blamed_with_its_step(tmp_path, alone, kind, code, sentence):
    deadlines = FAST if code == ExitCode.STEP_TIMEOUT else ()
    result = run_joints(tmp_path, fault("controller", kind, 7), *deadlines, in_process=alone)
    assert (result.exit_code, result.participant) == (code, "controller")
    assert re.search(sentence, result.reason)
    assert recorded_steps(result)[:8] == list(range(8))


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("message", r"controller\.command.*not a JointCommand/1: values"),
        ("mistyped", r"JointCommand/1: .*values"),
        ("envelope", r"controller.*not a Outputs/1: step"),
        ("skip", r"controller skipped from step 6 to 8|reported step 8 instead"),
        ("time", r"wrong token or time"),
    ],
)  # fmt: skip
def test_a_broken_message_ends_the_run_and_blames_its_sender(tmp_path, kind, sentence):
    result = run_joints(tmp_path, fault("controller", kind, 7))
    assert (result.exit_code, result.participant) == (ExitCode.FAULT, "controller")
    assert re.search(sentence, result.reason)
    assert recorded_steps(result)[:7] == list(range(7))


def test_garbage_in_place_of_outputs_is_named_when_the_step_times_out(tmp_path):
    slow = "plant.step_timeout=1s"
    result = run_joints(tmp_path, fault("controller", "garbage", 7), slow, *FAST)
    assert (result.exit_code, result.participant) == (ExitCode.STEP_TIMEOUT, "controller")
    assert "step 7 (t = 0.035 s): controller" in result.reason


@pytest.mark.parametrize(
    ("alone", "kind", "sentence"),
    [
        (False, "raise", r"before the first step: controller \(pid \d+\): ValueError: the knee"),
        (False, "exit", r"before the first step: controller \(pid \d+\) exited with code 3"),
        (False, "hang", r"controller \(pid \d+\) has joined and is not ready.*0\.3 s \(participants\.controller\.ready_timeout\)"),
        (True, "raise", r"before the first step: controller \(pid \d+\): ValueError: the knee"),
        (True, "leave", r"before the first step: controller \(pid \d+\) exited with code 3"),
        (True, "hang", r"controller \(pid \d+\) has been computing for .* at joints\.py:\d+ in go_wrong.*ready_timeout"),
    ],
)  # fmt: skip
def test_a_participant_that_cannot_get_ready_is_named(tmp_path, alone, kind, sentence):
    # In one process, the three are one.
    phases = ("spawn", "join", "ready") if alone else ("ready",)
    short = [f"controller.{phase}_timeout=300ms" for phase in phases] if kind == "hang" else []
    result = run_joints(tmp_path, fault("controller", kind, -1), *short, in_process=alone)
    assert (result.exit_code, result.participant) == (ExitCode.START, "controller")
    assert re.search(sentence, result.reason)


def test_a_program_for_another_version_of_a_message_is_refused_naming_both_sides(tmp_path):
    result = run_joints(tmp_path, "controller.participant=joints.py:Future")
    assert result.exit_code == ExitCode.START
    assert "has JointCommand/2, the scenario" in result.reason


@pytest.mark.slow
def test_a_slow_start_of_one_is_not_blamed_on_those_that_wait_for_it(tmp_path):
    result = run_joints(
        tmp_path, fault("plant", "hang", -1), "plant.ready_timeout=2s", "controller.ready_timeout=1s"
    )  # fmt: skip
    assert (result.exit_code, result.participant) == (ExitCode.START, "plant")


@pytest.mark.parametrize(
    ("kind", "code"), [("hang-at-close", ExitCode.STOP_TIMEOUT), ("raise-at-close", ExitCode.DIED)]
)
def test_a_participant_that_does_not_end_is_named_and_the_recording_is_complete(
    tmp_path, kind, code
):
    deadlines = ["controller.stop_timeout=1s"] if code == ExitCode.STOP_TIMEOUT else []
    result = run_joints(tmp_path, fault("controller", kind, 0), *deadlines)
    assert (result.exit_code, result.participant) == (code, "controller")
    assert recorded_steps(result) == list(range(101))


SCRIPT = """
import time
from pathlib import Path
from joints import Controller
from stepbus_participant import main

code = main(Controller)
while not Path("plotted").exists():
    time.sleep(0.02)
raise SystemExit(code)
"""


class Plots(RunExtension):
    """Lets a script end once its deadline is over."""

    def __init__(self, folder):
        self.folder = folder

    def awaiting(self, participants):
        is_stopping = self.run.state.phase.is_stopping
        if is_stopping and self.run.clock.monotonic() > self.run.ended_at + 11:
            (self.folder / "plotted").touch()


@pytest.mark.slow
def test_a_script_that_plots_behind_its_part_in_the_run_makes_no_failure(tmp_path):
    source = write_scenario(tmp_path / "source").parent
    (source / "script.py").write_text(SCRIPT)
    own = ["controller.exec=[python, script.py]", "controller.stop_timeout=10s"]
    result = run_joints(tmp_path, *own, extensions=[Plots(source)])
    assert (result.exit_code, (source / "plotted").exists()) == (0, True), result.reason


def test_a_port_in_use_is_named(tmp_path):
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        port = busy.getsockname()[1]
        result = run_joints(tmp_path, "bus.transport=tcp", f"bus.port={port}")
    assert result.exit_code == ExitCode.BUS
    assert f"port {port} on 127.0.0.1 cannot be used" in result.reason


def test_a_participant_can_end_the_run_and_everybody_finishes_that_step(tmp_path):
    result = run_joints(tmp_path, fault("controller", "end", 41))
    assert (result.exit_code, result.steps) == (0, 42)
    assert result.reason == "controller: the goal is reached"
    assert recorded_steps(result) == list(range(43))


STOPS = "import os; os.kill(os.getpid(), 19)"


STOPPED = r"a signal or a debugger has stopped it"
KEPT = {
    "stopped": ("[python, -c, 'STOPS']", f"has not reached the bus; {STOPPED}"),
    "stopped shell": ("[sh, -c, 'kill -STOP $$']", rf"{STOPPED}; `kill -CONT -\d+`"),
    "stopped child": ("[sh, -c, 'python3 -c \"STOPS\"; true']", f"not reached the bus; {STOPPED}"),
    "busy": (
        "[python, -c, 'while True: pass']",
        r"bus; it has computed for \d+\.\d s; what does it",
    ),
    "asleep": (
        "[sleep, '1000']",
        r"the bus; does its program take part with stepbus\? It had 2 s [(]participants",
    ),
    "reads stdin": (
        "[python, -c, 'input()']",
        r'code 1; its last output: ".*EOFError: EOF when reading a line"',
    ),
}
QUICK = ("stopped child", "reads stdin")


@pytest.mark.parametrize(
    ("program", "sentence"),
    [
        pytest.param(*row, id=name, marks=() if name in QUICK else pytest.mark.slow)
        for name, row in KEPT.items()
    ],
)
def test_what_keeps_a_program_from_the_bus_is_named(tmp_path, program, sentence):
    program = program.replace("STOPS", STOPS)
    # The last one ends by itself.
    deadlines = [] if "input()" in program else ["controller.spawn_timeout=2s"]
    result = run_joints(tmp_path, f"controller.exec={program}", *deadlines)
    assert (result.exit_code, result.participant) == (ExitCode.START, "controller")
    assert re.search(sentence, result.reason)
