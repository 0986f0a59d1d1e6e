"""Participants on a host that is reached over SSH: the same bytes, and nothing is left there."""

import signal
import sys
import time

import psutil
import pytest
from support.runs.distant import ENDLESS, LEASE_S, NAMES, SHORT
from support.runs.sshd import USER

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

MARGIN_S = 2.0
pytestmark = pytest.mark.usefixtures("nothing_is_left")


def assert_same(robot, folder):
    result = robot.result()
    local = run(load("two_link", [*SHORT]), Options(out=folder / "local"))
    assert (result["exit_code"], result["messages_sha256"]) == (0, local.messages_sha256), (
        robot.said()
    )
    assert robot.is_empty(LEASE_S), robot.processes()


def test_a_participant_on_another_host_gives_the_same_bytes(tmp_path, robot):
    assert_same(robot.start(*SHORT), tmp_path)
    assert f"listening: {robot.wan.addresses[0]}:" in robot.said()
    assert (robot.out / "logs/controller.log").read_bytes() == b""


@pytest.mark.slow
def test_all_participants_on_another_host_give_the_same_bytes(tmp_path, robot):
    robot.wan.shape(delay_s=0.010, jitter_s=0.0025, loss=0.01)
    assert_same(robot.start(*SHORT, names=NAMES), tmp_path)


@pytest.mark.slow
def test_what_it_prints_comes_back(tmp_path, robot):
    program = "echo printed there, in $PWD >&2; exit 7"
    robot.start(*SHORT, "controller.participant=", f"controller.exec=[sh, -c, '{program}']")
    result = robot.result()
    assert (result["exit_code"], result["participant"]) == (ExitCode.START, "controller")
    assert f"on {USER}) exited with code 7" in result["reason"]
    log = (robot.out / "logs/controller.log").read_text()
    assert log.startswith(f"printed there, in {robot.tmp}/stepbus-")
    assert robot.is_empty(LEASE_S), robot.processes()


@pytest.mark.slow
def test_a_child_that_prints_without_end_holds_up_nothing(robot):
    program = "yes printed >&2 & sleep 1; exit 7"
    robot.start(*SHORT, "controller.participant=", f"controller.exec=[sh, -c, '{program}']")
    result = robot.result()
    assert f"on {USER}) exited with code 7" in result["reason"]
    assert (robot.out / "logs/controller.log").read_bytes().startswith(b"printed\nprinted\n")
    assert robot.is_empty(LEASE_S), robot.processes()


@pytest.mark.slow
def test_a_program_that_is_missing_there_is_told_with_its_participant(robot):
    robot.start(*SHORT, "controller.participant=", "controller.exec=[nowhere]")
    assert robot.result()["reason"].startswith(f"controller: on {USER}: no program 'nowhere'")


def the_orchestrator(robot):
    return robot.orchestrator


def its_ssh(robot):
    (found,) = [one for one in robot.orchestrator.children() if one.name() == "ssh"]
    return found


def the_agent(robot):
    (found,) = [one for one in robot.processes("stepbus_hosts.agent") if one.name() != "sh"]
    return found


def the_participant(robot):
    (found,) = robot.processes("stepbus_controller")
    return found


@pytest.mark.slow
@pytest.mark.parametrize("find", [the_orchestrator, its_ssh, the_agent, the_participant])
def test_whatever_is_killed_nothing_is_left(robot, find):
    robot.start(*ENDLESS).under_way()
    struck = find(robot)
    since = time.monotonic()
    struck.kill()
    assert robot.is_empty(LEASE_S + MARGIN_S), robot.processes()
    if find is not the_orchestrator:
        result = robot.result()
        assert (result["exit_code"], result["participant"]) == (ExitCode.DIED, "controller"), (
            robot.said()
        )
        assert USER in result["reason"]
    assert time.monotonic() - since < LEASE_S + MARGIN_S


@pytest.mark.slow
def test_an_agent_that_is_frozen_is_named(robot):
    robot.start(*ENDLESS, "controller.step_timeout=60s").under_way()
    agent, since = the_agent(robot), time.monotonic()
    agent.send_signal(signal.SIGSTOP)
    result = robot.result()
    assert (result["exit_code"], result["participant"]) == (ExitCode.DIED, "controller")
    assert time.monotonic() - since < LEASE_S + MARGIN_S
    agent.send_signal(signal.SIGCONT)
    assert robot.is_empty(LEASE_S + MARGIN_S), robot.processes()


@pytest.mark.slow
def test_a_host_that_is_cut_off_is_named_and_ends_all(robot):
    robot.start(*ENDLESS).under_way()
    since = time.monotonic()
    robot.wan.cut(1)
    result = robot.result()
    assert (result["exit_code"], result["participant"]) == (ExitCode.STEP_TIMEOUT, "controller")
    assert time.monotonic() - since < LEASE_S + MARGIN_S
    left_s = LEASE_S + MARGIN_S - (time.monotonic() - since)
    # The sshd of a session that is cut off waits for TCP; it is not ours.
    ours = lambda: [one for one in robot.processes() if one.name() != "sshd"]  # noqa: E731
    assert psutil.wait_procs(ours(), left_s)[1] == []
    assert not list(robot.tmp.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"python": "/nowhere/python"}, "/nowhere/python"),
        ({"python": f"{sys.base_prefix}/bin/python3"}, "stepbus is not installed for"),
        ({"address": "10.9.0.77"}, "timed out"),
        ({"ssh": ["-F", "none", "-p", "9"]}, "refused"),
        ({"user": "nobody"}, "nobody@"),
    ],
    ids=str,
)
def test_a_host_that_cannot_take_part_is_said_once(robot, changed, words):
    since = time.monotonic()
    result = robot.start(*SHORT, **changed).result()
    assert result["exit_code"] == ExitCode.START, robot.said()
    assert result["reason"].startswith(f"host {USER} ")
    assert words in result["reason"]
    assert robot.terminal.read_text().count(f"host {USER} ") == 1
    assert time.monotonic() - since < 40
    assert robot.is_empty(LEASE_S), robot.processes()
