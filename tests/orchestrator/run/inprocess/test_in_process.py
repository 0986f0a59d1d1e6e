"""A run in one process: the same bytes, the same failures, and nothing left behind."""

import json
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from support.runs.joints import fault, run_joints, write_scenario
from support.surroundings import comes_true
from support.tools import needs_pybullet

import stepbus
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.inprocess.heartbeat import Heartbeat
from stepbus_orchestrator.run.inprocess.hub import HostedParticipant, Hub
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import Endpoint, LoopbackBus, Ticket

FAST = ("controller.step_timeout=1s", "controller.stop_timeout=1s")
STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]


@pytest.mark.parametrize("window", [1, 2, 64])
def test_the_recording_is_that_of_separate_processes(tmp_path, separate, window):
    result = run_joints(tmp_path, f"window={window}", in_process=True)
    assert (result.exit_code, result.steps) == (0, 100)
    assert result.sha256 == separate.sha256


@pytest.mark.parametrize("text", ["drop controller at 20", pytest.param("corrupt plant at 20", marks=pytest.mark.slow), "duplicate mission at 20"])  # fmt: skip
def test_faults_on_messages_end_alike(tmp_path, text):
    path = write_scenario(tmp_path / "source")
    deadline = "30s" if text.startswith("duplicate") else "3s"
    overrides = [f"{name}.step_timeout={deadline}" for name in ("controller", "plant")]
    scenario = load(path, overrides, [text])
    results = [
        run(scenario, Options(out=tmp_path / str(alone), host=host_of(in_process=alone)))
        for alone in (False, True)
    ]
    sentences = [re.sub(r"\(pid \d+\)|/[0-9a-zA-Z/_.-]*/|\d+\.\d s", "", r.reason) for r in results]
    assert sentences[0].replace("False", "") == sentences[1].replace("True", "")
    assert results[0].exit_code == results[1].exit_code
    if not results[0].exit_code:
        assert results[0].sha256 == results[1].sha256


def test_a_participant_that_failed_is_held(tmp_path):
    path = write_scenario(tmp_path / "source")
    overrides = [fault("mission", "raise", 40), "mission.on_fault=hold"]
    results = [
        run(
            load(path, overrides),
            Options(out=tmp_path / str(alone), host=host_of(in_process=alone)),
        )
        for alone in (False, True)
    ]
    assert [result.exit_code for result in results] == [ExitCode.FAULT] * 2
    assert "its commands were held from step 40" in results[1].reason
    assert results[0].steps == results[1].steps


def test_what_needs_a_process_is_refused_with_every_reason(tmp_path):
    path = write_scenario(tmp_path / "source")
    programs = ["controller.exec=[sleep, '1']", "mission.exec=[python, joints.py, mission]"]
    with pytest.raises(stepbus.WiringError) as caught:
        run(load(path, programs), Options(out=tmp_path / "out", host=InProcess()))
    sleeps, joints = str(caught.value).splitlines()
    assert "`sleep 1` is a separate program" in sleeps
    assert "write `participant: joints.py:CLASS`" in joints
    with pytest.raises(stepbus.WiringError, match="'kill plant at 3'"):
        run(load(path, (), ["kill plant at 3"]), Options(out=tmp_path / "out", host=InProcess()))
    assert not (tmp_path / "out").exists()


STUBBORN = """
import stepbus

class Stubborn(stepbus.Participant):
    def update(self, step):
        if step.index == 8:
            raise ValueError("no")

while True:
    try:
        stepbus.main(Stubborn)
    except BaseException:
        pass
    try:
        stepbus.HOST.get().bus.queue().get(timeout=1000)
    except BaseException:
        pass
"""


def test_one_that_does_not_let_itself_be_ended_is_given_up(tmp_path):
    write_scenario(tmp_path / "source")
    text = STUBBORN.replace("stepbus.HOST", "__import__('stepbus_participant').HOST")
    (tmp_path / "source" / "stubborn.py").write_text(text)
    overrides = ["mission.participant=stubborn.py:Stubborn", "mission.stop_timeout=500ms"]
    scenario = load(tmp_path / "source" / "scenario.yaml", overrides)
    result = run(scenario, Options(out=tmp_path / "out", host=InProcess()))
    assert (result.exit_code, result.participant) == (ExitCode.FAULT, "mission")
    assert "ValueError: no" in result.reason


def test_the_user_can_end_it(tmp_path):
    class AtItsFirstSteps(Observer):
        def progress(self, progress):
            if progress.step > 0:
                interrupt.set()

    interrupt = threading.Event()
    result = run(
        load(write_scenario(tmp_path / "source"), ["duration=10h"]),
        Options(out=tmp_path / "out", host=InProcess()),
        AtItsFirstSteps(),
        interrupt,
    )
    assert result.exit_code == ExitCode.INTERRUPTED
    assert result.steps > 0


@pytest.mark.slow
def test_ctrl_c_ends_one_that_computes(tmp_path):
    path = write_scenario(tmp_path / "source")
    process = subprocess.Popen(
        [*STEPBUS, "run", str(path), "--in-process", "--json", "--out", str(tmp_path / "out"),
         "--set", fault("controller", "hang", 7), "--set", "controller.step_timeout=60s"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    log = tmp_path / "out/logs/controller.log"
    try:
        assert comes_true(lambda: log.exists() and "it hangs" in log.read_text())
    finally:
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=30)
    assert process.returncode == ExitCode.INTERRUPTED, errors
    assert json.loads(output)["outcome"] == "failed"


@pytest.mark.slow
@needs_pybullet
def test_the_greeting_of_pybullet_is_nowhere(tmp_path):
    done = subprocess.run(
        [*STEPBUS, "run", "two_link", "--in-process", "--json", "--set", "duration=10ms",
         "--set", "plant.params.engine=pybullet", "--out", str(tmp_path / "out")],
        capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    assert "build time" not in done.stdout + done.stderr
    logs = (tmp_path / "out/logs").iterdir()
    assert [log.name for log in logs if "build time" in log.read_text()] == []


def worker(hub, words, program, log="/dev/null"):
    bus = LoopbackBus(make_queue=hub.queue)
    ticket = Ticket(
        run="r", name="worker", token="", endpoint=Endpoint(listen=[], connect=["this process"]),
        join_timeout_s=1.0, faults=[],
    )  # fmt: skip
    return HostedParticipant(
        hub, ticket, bus, Path(log), program, words=words, number=1, shown=False
    )  # fmt: skip


def test_a_log_on_a_full_disk_fails_nobody_else():
    def leave() -> int:
        raise SystemExit("no room for this")

    hub, heartbeat = Hub(time), Heartbeat()
    hosted = worker(hub, heartbeat.words, leave, "/dev/full")
    assert hosted.wait(5)
    hosted.end()
    heartbeat.close()
    assert hosted.exit_code() == 1


def test_no_wait_is_over_while_a_participant_can_go_on():
    hub, heartbeat, got = Hub(time), Heartbeat(), []
    awaited, unread, asked = (hub.queue() for _ in range(3))
    programs = (
        lambda: got.append(awaited.get(timeout=60)) or 0,
        lambda: awaited.put(asked.get()) or 0,
        lambda: unread.put("news") or 0,
        lambda: asked.put("answer") or 0,
    )
    for hosted in [worker(hub, heartbeat.words, program) for program in programs]:
        assert hosted.wait(5)
        hosted.end()
    heartbeat.close()
    assert got == ["answer"]
