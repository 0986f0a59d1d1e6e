"""Calls that steer a controller and a mission: from the next step on, and again in a rerun."""

import math
from functools import partial

import pytest
from support.runs.asker import Asker

from stepbus_orchestrator import cli
from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.run.extensions.calls import Calls
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import CallRecord

AT = 100
"""The step of the calls, of 200."""


def steered(folder, *calls, scenario="two_link/pid", overrides=()):
    """Run a scenario with calls `participant method args…` before step 100."""
    planned = [
        CallRecord(step=AT, participant=who, method=method, args=list(args))
        for who, method, *args in calls
    ]
    checked = load(scenario, ["duration=1s", *overrides])
    result = run(checked, Options(out=folder, extensions=[Calls(new=planned)], host=InProcess()))
    assert result.exit_code == 0, result.reason
    return result.recording


def failure(folder, *call, scenario="two_link/pid"):
    """Return why a call is refused."""
    with pytest.raises(AssertionError) as caught:
        steered(folder, call, scenario=scenario)
    return str(caught.value)


def command(recording):
    return Recording(recording)["controller.command"].values


def reference(recording):
    return Recording(recording)["mission.reference"]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return steered(tmp_path_factory.mktemp("plain") / "out")


def test_a_gain_counts_from_the_step_of_its_call_on(plain, tmp_path):
    changed = steered(tmp_path / "out", ("controller", "set", "kp", 400))
    assert (command(changed)[:AT] == command(plain)[:AT]).all()
    state, wanted = Recording(plain)["plant.joint_state"], reference(plain)
    error = wanted.position[AT] - state.position[AT]
    assert command(changed)[AT] - command(plain)[AT] == pytest.approx(200 * error)


def test_a_gain_may_be_one_for_each_joint(plain, tmp_path):
    gains = {"joint1": 200, "joint2": 400}
    changed = steered(tmp_path / "out", ("controller", "set", "kp", gains))
    assert command(changed)[AT][0] == command(plain)[AT][0]
    assert command(changed)[AT][1] != command(plain)[AT][1]


def test_the_integral_stays_when_its_gain_changes(plain, tmp_path):
    changed = steered(tmp_path / "out", ("controller", "set", "ki", 0))
    state, wanted = Recording(plain)["plant.joint_state"], reference(plain)
    error = wanted.position[AT] - state.position[AT]
    assert command(plain)[AT] - command(changed)[AT] == pytest.approx(200 * error * 0.005)


@pytest.mark.parametrize("scenario", ["two_link", "two_link/pd", "two_link/pd_gravity"])
def test_every_law_takes_its_gains(tmp_path, scenario):
    calls = [("controller", "set", key, 1) for key in ("kp", "kd")]
    found = command(steered(tmp_path / "out", *calls, scenario=scenario))
    before = command(steered(tmp_path / "plain", scenario=scenario))
    assert (found[:AT] == before[:AT]).all()
    assert (found[AT] != before[AT]).any()


@pytest.mark.slow
def test_what_is_steered_is_repeated_and_branched(tmp_path):
    calls = [
        ("controller", "set", "kp", 400),
        ("mission", "set_target", "joint1", 0.5, 0.3),
        ("mission", "set", "omega", 3),
    ]
    recording = steered(tmp_path / "out", *calls)
    assert Preparation(recording, tmp_path / "again").run().equal
    assert branch(recording, tmp_path / "branch", at=AT + 20, in_process=True).equal
    for participant in ("controller", "mission"):
        assert replay(recording, participant, recorded=True).equal


def test_a_branch_steers(plain, tmp_path):
    call = "controller set kp 400"
    found = branch(plain, tmp_path / "b", at=AT, calls=[call], in_process=True)
    steered_run = steered(tmp_path / "out", ("controller", "set", "kp", 400))
    assert found.result.recording.read_bytes() == steered_run.read_bytes()


def test_a_joint_goes_to_its_target_without_a_jump_and_stays(tmp_path):
    recording = steered(tmp_path / "out", ("mission", "set_target", "joint1", 0.9, 0.25))
    found = reference(recording)
    position, velocity = found.position[:, 0], found.velocity[:, 0]
    assert abs(position[1:] - position[:-1]).max() < 0.05
    assert position[AT + 50 :] == pytest.approx(0.9)
    assert velocity[AT + 50 :] == pytest.approx(0.0)
    t = found.t
    assert found.position[:, 1] == pytest.approx([math.cos(x) for x in t])


@pytest.mark.parametrize(("target", "position"), [(0.2, 0.2), ("-30deg", math.radians(-30))])
def test_a_target_without_a_time_is_there_at_once(tmp_path, target, position):
    found = reference(steered(tmp_path / "out", ("mission", "set_target", "joint2", target)))
    assert found.position[AT - 1][1] == pytest.approx(math.cos((AT - 1) * 0.005))
    assert (found.position[AT:, 1] == position).all()


def test_a_joint_follows_the_task_again(tmp_path):
    calls = [("mission", "set_target", "joint2", 0.2), ("mission", "follow_task", "joint2")]
    found = reference(steered(tmp_path / "out", *calls))
    assert found.position[AT][1] == pytest.approx(math.cos(AT * 0.005))


def test_another_frequency_goes_on_from_the_angle_that_the_sine_has(tmp_path):
    found = reference(steered(tmp_path / "out", ("mission", "set", "omega", 4)))
    angle = AT * 0.005
    assert found.position[AT][0] == pytest.approx(math.sin(angle))
    assert found.velocity[AT][0] == pytest.approx(4 * math.cos(angle))
    assert found.position[AT + 50][0] == pytest.approx(math.sin(angle + 4 * 0.25))


@pytest.mark.parametrize(
    ("call", "why"),
    [
        (("controller", "set", "kq", 1), "'kq' cannot be set; did you mean 'kp', 'kd' or 'ki'?"),
        (("controller", "set", "kp", -1), "kp"),
        (("controller", "set", "kp", [1, 2, 3]), "kp"),
        (("controller", "set", "law", "pd"), "'law' cannot be set"),
        (("mission", "set_target", "elbow", 1), "joint 'elbow' is unknown"),
        (
            ("mission", "set_target", "joint1", "far"),
            "'far' is not a position; write radians, or degrees",
        ),
        (("mission", "set_target", "joint1", "30rad"), "'30rad' is not a position"),
        (("mission", "set_target", "joint1", [1]), "is not a valid target"),
        (("mission", "set_target", "joint1", 1, -1), "is not a valid target"),
        (("mission", "set", "omega", "fast"), "omega"),
        (("mission", "set", "omega", [1, 2, 3]), "omega"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, call, why):
    assert why in failure(tmp_path / "out", *call)


def test_the_feed_forward_is_the_torque_of_the_acceleration(plain, tmp_path):
    ahead = steered(tmp_path / "out", overrides=["controller.params.feed_forward=0.5"])
    difference = command(ahead)[0] - command(plain)[0]
    assert difference == pytest.approx(0.5 * reference(plain).acceleration[0])


@pytest.mark.slow
def test_a_second_terminal_steers_a_run_of_processes(tmp_path, capsys):
    out, pace = tmp_path / "out", Pace(AT)
    words = [
        ["call", str(out), "controller", "set", "kp", "400"],
        ["call", str(out), "mission", "set_target", "joint1", "30deg", "0.2"],
        ["call", str(out), "controller", "get", "kp"],
    ]
    asker = Asker(pace, [partial(cli.main, line) for line in words])
    result = run(load("two_link/pid", ["duration=1s"]), Options(out=out, extensions=[pace]), asker)
    assert asker.answers == [0, 0, 0]
    assert capsys.readouterr().out.split() == ["200", "null", "400"]
    assert reference(result.recording).position[-1][0] == pytest.approx(math.radians(30))
    again = Preparation(result.recording, tmp_path / "again").run()
    assert again.equal
