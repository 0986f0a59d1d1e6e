"""The plots of a run: which panels there are, and what they show."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from stepbus_orchestrator.analysis.signals import read_tracking
from stepbus_orchestrator.recording import Entry, Port, Recording
from stepbus_orchestrator.report import report
from stepbus_orchestrator.report.device_panels import device_panels, held_spans
from stepbus_schemas import (
    BaseState,
    Description,
    Goal,
    GripperState,
    JointCommand,
    JointState,
    Poses,
    encode,
)

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
STEP_NS = 10_000_000


def record(path=Path("none.mcap"), **ports) -> Recording:
    """Return a recording; ports: name → type, names, messages."""
    recording = Recording(path=path)
    for name, (kind, names, messages) in ports.items():
        topic = f"plant/{name}"
        recording.ports[topic] = Port(
            topic=topic,
            participant="plant",
            name=name,
            type=kind,
            description=Description(names=names),
        )
        recording.entries[topic] = [
            Entry(step=n, t_ns=n * STEP_NS, data=encode(m)) for n, m in enumerate(messages)
        ]
    return recording


def arm(mode="position", **state):
    states = [JointState(position=[0.1 * n], velocity=[0.0], **state) for n in range(4)]
    commands = [JointCommand(mode=mode, values=[7.0]) for _ in range(4)]
    return {
        "arm": ("JointState/1", ["j"], states),
        "command": ("JointCommand/1", ["j"], commands),
    }


def mobile():
    bases = [BaseState(x=0.5 * n, y=0.0, yaw=0.0, vx=1.0, wz=0.0) for n in range(4)]
    hands = [GripperState(width=0.08, force=0.0, holding=n in {1, 2}) for n in range(4)]
    goal = Goal(id=1, type="move_linear", tip="grasp")
    poses = [
        Poses(position=[(0, 0, 9.0), (0, 0, 0.1 * n)], orientation=[UPRIGHT] * 2) for n in range(4)
    ]
    return {
        "odometry": ("BaseState/1", ["l", "r"], bases),
        "hand": ("GripperState/1", ["a", "b"], hands),
        "goal": ("Goal/1", [], [goal]),
        "poses": ("Poses/1", ["chassis", "grasp"], poses),
    }


def draw(panel):
    axis = Figure().subplots()
    panel(axis)
    return axis


def test_a_recording_without_devices_has_no_panels_of_them():
    assert device_panels(record(**arm())) == []


def test_a_mobile_manipulator_has_path_speed_gripper_and_height():
    titles = [draw(panel).get_title() for panel in device_panels(record(**mobile()))]
    assert titles == [
        "path of the base, by odometry",
        "velocity of the base",
        "gripper",
        "height of grasp",
    ]


def test_a_gripper_alone_has_its_panel_alone():
    only = {"hand": mobile()["hand"]}
    assert [draw(panel).get_title() for panel in device_panels(record(**only))] == ["gripper"]


def test_the_path_is_that_of_odometry():
    x, y = draw(device_panels(record(**mobile()))[0]).lines[0].get_data()
    assert (list(x), list(y)) == ([0.0, 0.5, 1.0, 1.5], [0.0] * 4)


def test_the_height_is_that_of_the_link_that_goals_move():
    line = draw(device_panels(record(**mobile()))[3]).lines[0]
    assert line.get_ydata() == pytest.approx([0.0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("holding", "spans"),
    [
        ([0, 0, 0, 0], []),
        ([0, 1, 1, 0], [(1.0, 3.0)]),
        ([1, 0, 0, 1], [(0.0, 1.0), (3.0, 3.0)]),
        ([1, 1, 1, 1], [(0.0, 3.0)]),
    ],
)
def test_spans_of_holding_last_until_it_is_lost(holding, spans):
    assert held_spans(np.arange(4.0), np.array(holding, dtype=bool)) == spans


def test_positions_that_are_commanded_are_not_shown_as_torques():
    assert read_tracking(record(**arm("position"))).command is None
    assert read_tracking(record(**arm("torque"))).command.fields["values"].tolist() == [[7.0]] * 4


def test_without_a_reference_the_error_is_that_of_the_motors():
    axis = draw(lambda axis: report._error(axis, read_tracking(record(**arm(target=[0.5])))))
    assert axis.get_title() == "error of the motors: target − measured"
    assert axis.lines[1].get_ydata() == pytest.approx([0.5, 0.4, 0.3, 0.2])


def test_the_plots_of_a_mobile_manipulator_are_written(tmp_path):
    path = tmp_path / "report.png"
    recording = record(**arm(target=[0.5]), **mobile())
    report._draw("store", read_tracking(recording), device_panels(recording), path)
    assert path.read_bytes().startswith(b"\x89PNG")
