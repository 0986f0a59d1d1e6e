"""Participants that somebody else starts: the same bytes, and the same blame, as with children."""

import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from support.messages.recordings import messages
from support.paths import CHECKOUT
from support.runs.elsewhere import JOIN, SHORT, Elsewhere, run_with_external
from support.runs.joints import run_joints, write_scenario
from support.surroundings import comes_true
from support.tools import needs

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.extensions import external
from stepbus_orchestrator.run.extensions.debug import Debug
from stepbus_orchestrator.run.extensions.external import External
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import WiringError

pytestmark = pytest.mark.usefixtures("nothing_is_left")
TICKET = "out/controller.ticket"


@pytest.fixture(scope="module")
def as_child(tmp_path_factory):
    """Return the result of the run that starts all participants itself, in one process."""
    return run_joints(tmp_path_factory.mktemp("child"), *SHORT, in_process=True)


@pytest.fixture
def elsewhere():
    found = Elsewhere()
    yield found
    found.close()


def test_a_participant_that_waits_for_its_run_gives_the_bytes_of_a_child(
    tmp_path, elsewhere, as_child
):
    ticket = tmp_path / "c.ticket"
    process = elsewhere.join(ticket, "--wait", "60s")
    assert "no ticket there" in elsewhere.wait_until_it_waits(process)
    result, _ = run_with_external(tmp_path, tickets={"controller": ticket})
    assert (result.exit_code, result.sha256) == (0, as_child.sha256)
    assert process.wait(60) == 0
    assert not ticket.exists()


def test_a_participant_that_comes_later_gives_the_bytes_of_a_child(
    tmp_path, elsewhere, as_child, monkeypatch
):
    monkeypatch.setattr(external, "_REMIND_S", 0.2)
    result, told = run_with_external(
        tmp_path, invited=lambda: elsewhere.join(tmp_path / TICKET), words="has not joined yet"
    )
    assert (result.exit_code, result.sha256) == (0, as_child.sha256)
    assert f"stepbus join {tmp_path / TICKET}" in told[0]
    assert "has not joined yet" in told[1]


def test_who_never_comes_is_named(tmp_path, elsewhere):
    result, _ = run_with_external(tmp_path, "controller.spawn_timeout=500ms")
    assert (result.exit_code, result.participant) == (ExitCode.START, "controller")
    assert "controller (external) has not joined" in result.reason
    assert f"stepbus join {tmp_path / TICKET}" in result.reason


def test_who_is_killed_is_named(tmp_path, elsewhere):
    processes = []
    result, _ = run_with_external(
        tmp_path,
        invited=lambda: processes.append(elsewhere.join(tmp_path / TICKET)),
        paused=lambda: os.kill(processes[0].pid, signal.SIGKILL),
    )
    assert (result.exit_code, result.participant) == (ExitCode.DIED, "controller")
    assert f"controller (external, pid {processes[0].pid}) has left the bus" in result.reason
    assert "in the terminal where it was started" in result.reason
    assert result.at_step == 30


@pytest.mark.slow
def test_who_is_frozen_is_named(tmp_path, elsewhere):
    processes = []
    result, _ = run_with_external(
        tmp_path,
        "controller.step_timeout=2s",
        invited=lambda: processes.append(elsewhere.join(tmp_path / TICKET)),
        paused=lambda: processes[0].send_signal(signal.SIGSTOP),
    )
    assert (result.exit_code, result.participant) == (ExitCode.STEP_TIMEOUT, "controller")
    assert "stopped by a signal or a debugger" in result.reason
    # It is not ours: it lives, and ends by itself once it continues.
    assert processes[0].poll() is None
    processes[0].send_signal(signal.SIGCONT)
    # The `Stop` may have come before its link was cut.
    assert processes[0].wait(60) in (0, 1)


@pytest.mark.slow
def test_who_comes_twice_is_let_in_once(tmp_path, elsewhere, as_child):
    seconds = []

    def paused():
        second = elsewhere.join(tmp_path / TICKET)
        seconds.append(second.wait(60))

    result, _ = run_with_external(
        tmp_path, invited=lambda: elsewhere.join(tmp_path / TICKET), paused=paused
    )
    assert seconds[0] != 0
    assert (result.exit_code, result.sha256) == (0, as_child.sha256)


def test_a_run_is_ended_while_it_waits(tmp_path):
    interrupt = threading.Event()
    result, _ = run_with_external(tmp_path, invited=interrupt.set, interrupt=interrupt)
    assert result.exit_code == ExitCode.INTERRUPTED
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "logs", "result.json", "run.mcap", "timing.mcap",
    ]  # fmt: skip


def test_whoever_is_left_by_a_killed_orchestrator_ends(tmp_path, own_temp, elsewhere):
    ticket = tmp_path / "c.ticket"
    run_it = ("run", "two_link", "--external", f"controller={ticket}", "--out", tmp_path / "out")
    program = (sys.executable, "-m", "stepbus_orchestrator.cli")
    orchestrator = elsewhere.start(*program, *run_it, "--set", "duration=1h")
    process = elsewhere.join(ticket)
    recording = tmp_path / "out/run.mcap"
    assert comes_true(lambda: recording.exists() and recording.stat().st_size > 50_000)
    orchestrator.kill()
    assert process.wait(60) == 1
    assert comes_true(lambda: not list(own_temp.iterdir()))
    assert not ticket.exists()


@pytest.mark.slow
def test_a_fallback_replaces_one_that_has_left(tmp_path, elsewhere):
    hold = "controller.on_fault=hold"
    pids = []

    def invited():
        pids.append(elsewhere.join(tmp_path / "a" / TICKET).pid)

    result, _ = run_with_external(
        tmp_path / "a", hold, invited=invited, paused=lambda: os.kill(pids[0], signal.SIGKILL)
    )
    child, _ = run_with_external(tmp_path / "b", hold, "faults=['kill controller at 30']", names=())
    assert (result.exit_code, child.exit_code) == (ExitCode.DIED, ExitCode.DIED)
    assert "its commands were held from step" in result.reason
    assert messages(result.recording) == messages(child.recording)


@pytest.mark.slow
def test_no_fallback_speaks_for_one_that_may_speak_itself(tmp_path, elsewhere):
    processes = []
    result, _ = run_with_external(
        tmp_path,
        "controller.on_fault=hold",
        "controller.step_timeout=2s",
        invited=lambda: processes.append(elsewhere.join(tmp_path / TICKET)),
        paused=lambda: processes[0].send_signal(signal.SIGSTOP),
    )
    assert (result.exit_code, result.participant) == (ExitCode.STEP_TIMEOUT, "controller")
    assert "held from" not in result.reason


@pytest.mark.slow
def test_a_bridged_program_in_another_language_gives_the_bytes_of_a_child(
    tmp_path, elsewhere, as_child
):
    needs("node")
    scenario = load(CHECKOUT / "examples/controllers/javascript/scenario.yaml", SHORT)
    child = run(scenario, Options(out=tmp_path / "child"))
    assert child.exit_code == 0, child.reason
    ticket = tmp_path / "c.ticket"
    elsewhere.join(ticket)
    external = load(
        CHECKOUT / "examples/controllers/javascript/scenario.yaml",
        [*SHORT, "controller.start=external"],
    )
    options = Options(out=tmp_path / "out", extensions=[External({"controller": ticket})])
    result = run(external, options)
    assert (result.exit_code, result.sha256) == (0, child.sha256)


def in_a_container():
    """Return a command with namespaces of its own: processes, network, mounts, users."""
    words = ["unshare", "--user", "--map-current-user", "--mount", "--pid", "--net", "--fork"]
    done = shutil.which("unshare") and subprocess.run(
        [*words, "true"], check=False, capture_output=True
    )
    if not done or done.returncode:
        pytest.skip("needs user namespaces")
    return [*words, *JOIN]


def as_a_service():
    """Return a command without a terminal and an environment, as under systemd."""
    return ["env", "-i", sys.executable, "-m", "stepbus_orchestrator.cli", "join"]


@pytest.mark.parametrize("command", [as_a_service, in_a_container])
def test_in_surroundings_of_its_own_it_gives_the_same_bytes(tmp_path, elsewhere, as_child, command):
    words = command()
    result, _ = run_with_external(
        tmp_path, invited=lambda: elsewhere.start(*words, tmp_path / TICKET, cwd="/")
    )
    assert (result.exit_code, result.sha256) == (0, as_child.sha256)


@pytest.mark.slow
def test_one_that_is_killed_in_a_container_is_named_without_its_process_id(tmp_path, elsewhere):
    words, processes = in_a_container(), []
    result, _ = run_with_external(
        tmp_path,
        invited=lambda: processes.append(elsewhere.start(*words, tmp_path / TICKET)),
        paused=lambda: os.killpg(processes[0].pid, signal.SIGKILL),
    )
    assert (result.exit_code, result.participant) == (ExitCode.DIED, "controller"), result.reason
    # Its process id is that of another namespace, and not shown as one of ours.
    assert "controller (external)" in result.reason


def test_the_exit_code_of_the_program_is_that_of_join(tmp_path, elsewhere):
    codes = []

    def invited():
        codes.append(elsewhere.join(tmp_path / TICKET, "--", "sh", "-c", "exit 7").wait(60))

    result, _ = run_with_external(tmp_path, "controller.spawn_timeout=500ms", invited=invited)
    assert (codes, result.exit_code) == ([7], ExitCode.START)


def test_what_else_runs_a_scenario_starts_everybody_itself(tmp_path):
    result = run_joints(tmp_path, *SHORT, "controller.start=external")
    assert result.exit_code == 0


@pytest.mark.parametrize(
    ("options", "overrides", "sentence"),
    [
        ({"host": InProcess()}, [], "omit --in-process"),
        ({"extensions": [External(), Debug(["controller"])]}, [], "--no-deadline controller"),
        ({}, ["faults=['freeze controller at 7']"], "cannot signal a process"),
        ({"extensions": [External({"controler": Path("x")})]}, [], "did you mean 'controller'"),
        (
            {"extensions": [External(), Debug(no_deadline=["controler"])]},
            [],
            "did you mean 'controller'",
        ),
    ],
)
def test_what_cannot_be_done_to_it_is_refused(tmp_path, options, overrides, sentence):
    scenario = load(write_scenario(tmp_path), ["controller.start=external", *overrides])
    with pytest.raises(WiringError, match=sentence):
        run(scenario, Options(out=tmp_path / "out", **{"extensions": [External()], **options}))
    shutil.rmtree(tmp_path)


def test_a_ticket_replaces_nothing_else(tmp_path):
    kept = tmp_path / "controller.py"
    kept.write_text("print('mine')")
    result, _ = run_with_external(tmp_path, tickets={"controller": kept})
    assert result.exit_code == ExitCode.START
    assert "it exists, perhaps as the ticket of another run" in result.reason
    assert kept.read_text() == "print('mine')"


@pytest.mark.parametrize(
    ("settings", "spawn_s"), [((), 120.0), (("controller.spawn_timeout=5s",), 5.0)]
)
def test_a_participant_with_a_ticket_is_external_and_has_its_own_time_to_come(settings, spawn_s):
    tickets = External({"controller": Path(TICKET)})
    spec = tickets.prepare(load("two_link", settings)).participant("controller")
    assert (spec.is_external, spec.deadlines.spawn_s) == (True, spawn_s)
