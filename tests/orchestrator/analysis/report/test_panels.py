"""The plots of a run: which panels there are, and what they show."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure
from support.runs.panels import arm, curves, sliding

from stepbus_orchestrator.analysis.report.curves.devices import Devices
from stepbus_orchestrator.analysis.report.curves.pose_errors import draw_pose_errors, pose_errors
from stepbus_orchestrator.analysis.report.panels.devices import device_panels, holding_spans
from stepbus_orchestrator.analysis.report.panels.joints import draw_panels
from stepbus_orchestrator.analysis.report.panels.tracking import (
    draw_error,
    draw_torque,
    draw_tracking,
)
from stepbus_orchestrator.analysis.report.report import draw_report
from stepbus_orchestrator.analysis.signals import Signal, Tracking, read_tracking
from stepbus_schemas import BaseState, Goal, GoalStatus, GripperState, Poses

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def mobile():
    bases = [BaseState(x=0.5 * n, y=0.0, yaw=0.0, vx=1.0, wz=0.0) for n in range(4)]
    grippers = [GripperState(width=0.08, force=0.0, holding=n in {1, 2}) for n in range(4)]
    goal = Goal(id=1, type="move_linear", tip="grasp")
    poses = [
        Poses(position=[(0, 0, 9.0), (0, 0, 0.1 * n)], orientation=[UPRIGHT] * 2) for n in range(4)
    ]
    return {
        "odometry": ("BaseState/1", ["l", "r"], bases),
        "gripper": ("GripperState/1", ["a", "b"], grippers),
        "goal": ("Goal/1", [], [goal]),
        "poses": ("Poses/1", ["chassis", "grasp"], poses),
    }


def draw(panel):
    axis = Figure().subplots()
    panel(axis)
    return axis


def test_a_recording_without_devices_has_no_panels_of_them(record):
    assert device_panels(record(**arm())) == []


def test_a_mobile_manipulator_has_path_speed_gripper_and_height(record):
    titles = [draw(panel).get_title() for panel in device_panels(record(**mobile()))]
    assert titles == [
        "path of the base, by odometry",
        "velocity of the base",
        "gripper",
        "height of grasp",
    ]


def test_a_gripper_alone_has_its_panel_alone(record):
    only = {"gripper": mobile()["gripper"]}
    assert [draw(panel).get_title() for panel in device_panels(record(**only))] == ["gripper"]


def test_the_path_is_that_of_odometry(record):
    x, y = draw(device_panels(record(**mobile()))[0]).lines[0].get_data()
    assert (list(x), list(y)) == ([0.0, 0.5, 1.0, 1.5], [0.0] * 4)


def test_a_map_that_comes_first_and_once_is_not_where_the_link_is(record):
    plan = Poses(position=[(0, 0, 9.0), (0, 0, 7.0)], orientation=[UPRIGHT] * 2)
    plans = {"planogram": ("Poses/1", ["chassis", "grasp"], [plan])}
    line = draw(device_panels(record(**plans, **mobile()))[3]).lines[0]
    assert list(line.get_ydata()) == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_the_height_is_that_of_the_link_that_goals_move(record):
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
    assert holding_spans(np.arange(4.0), np.array(holding, dtype=bool)) == spans


def test_positions_that_are_commanded_are_not_shown_as_torques(record):
    assert curves(read_tracking(record(**arm("position")))).torques == []
    (command,) = curves(read_tracking(record(**arm("torque")))).torques
    assert command.of("values", "j")[1].tolist() == [7.0] * 4


def test_without_a_reference_the_error_is_that_of_the_motors(record):
    axis = draw(lambda axis: draw_error(axis, curves(read_tracking(record(**arm(target=[0.5]))))))
    assert axis.get_title() == "error of the motors: target − measured"
    assert axis.lines[1].get_ydata() == pytest.approx([0.5, 0.4, 0.3, 0.2])


def test_the_plots_of_a_mobile_manipulator_are_written(record, tmp_path):
    path = tmp_path / "report.png"
    recording = record(**arm(target=[0.5]), **mobile())
    draw_report("store", curves(read_tracking(recording)), device_panels(recording), path)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_many_joints_have_a_panel_each_in_degrees():
    names = [f"j{n}" for n in range(7)]
    state = Signal(
        names=names,
        steps=np.arange(3),
        t=np.arange(3.0),
        fields={"position": np.full((3, 7), np.pi)},
        joint_types={"j6": "prismatic"},
    )
    figure = Figure(layout="constrained")
    draw_panels(figure, curves(Tracking(states={"a": state})))
    shown = [axis for axis in figure.axes if axis.axison]
    rest = ["error: target − measured", "joints over their index: range, end, target"]
    assert [axis.get_title() for axis in shown] == [*names, *rest]
    assert shown[0].lines[0].get_ydata() == pytest.approx([180.0] * 3)
    assert shown[6].lines[0].get_ydata() == pytest.approx([np.pi] * 3)


def test_each_arm_has_panels_of_its_joints_and_errors_and_its_angles_over_their_index():
    names = [f"{arm}_{joint}" for arm in ("left", "right") for joint in ("s0", "s1", "e0", "e1")]
    state = Signal(
        names=names,
        steps=np.arange(3),
        t=np.arange(3.0),
        fields={
            "position": np.radians(np.outer([1.0, 3.0, 2.0], np.arange(8.0))),
            "target": np.radians(np.outer([2.0, 2.0, 2.0], np.arange(8.0))),
        },
    )
    figure = Figure(layout="constrained")
    draw_panels(figure, curves(Tracking(states={"a": state})))
    shown = {axis.get_title(): axis for axis in figure.axes if axis.axison}
    left = ["left_s0", "left_s1", "left_e0", "left_e1", "left error: target − measured"]
    assert list(shown)[:5] == left
    right = shown["right error: target − measured"]
    assert right.lines[1].get_ydata() == pytest.approx([4.0, -4.0, 0.0])
    index = shown["right joints over their index: range, end, target"]
    assert [tick.get_text() for tick in index.get_xticklabels()] == ["0 s0", "1 s1", "2 e0", "3 e1"]
    spans, ends = index.lines[0::3], index.lines[1::3]
    assert [list(span.get_ydata()) for span in spans][1] == pytest.approx([5.0, 15.0])
    assert [float(end.get_ydata()[0]) for end in ends] == pytest.approx([8.0, 10.0, 12.0, 14.0])


def test_the_torque_panel_names_each_joint_with_its_limit():
    names = ["shoulder", "wrist_1", "wrist_2"]
    state = Signal(
        names=names,
        steps=np.arange(3),
        t=np.arange(3.0),
        fields={"position": np.zeros((3, 3)), "effort": np.full((3, 3), 40.0)},
        limits={"effort": [60.0, 28.0, 28.0]},
    )
    axis = draw(lambda a: draw_torque(a, curves(Tracking(states={"a": state}))))
    labels = axis.get_legend_handles_labels()[1]
    assert labels == [
        "shoulder, ±60", "wrist_1, ±28", "wrist_2, ±28", "limit ±28", "limit ±60",
    ]  # fmt: skip
    drawn = {round(float(np.mean(line.get_ydata()))) for line in axis.lines[3:]}
    assert drawn == {28, -28, 60, -60}


def torque_lines(has_effort):
    """Return the lines of the torque panel where 100 N·m are commanded and 10 N·m are applied."""
    t = np.arange(3.0)
    common = {"names": ["j"], "steps": np.arange(3), "t": t}
    effort = {"effort": np.full((3, 1), -10.0)} if has_effort else {}
    fields = {"position": np.zeros((3, 1)), **effort}
    state = Signal(**common, fields=fields, limits={"effort": [10.0]})
    asked = {"values": np.full((3, 1), -100.0)}
    torque = frozenset({"torque"})
    command = Signal(**common, fields=asked, limits={"effort": [200.0]}, modes=torque)
    tracking = Tracking(states={"a": state}, commands={"c": command})
    axis = draw(lambda a: draw_torque(a, curves(tracking)))
    return {line.get_label(): line for line in axis.lines if len(line.get_xdata()) == 3}


@pytest.mark.parametrize("has_effort", [True, False])
def test_the_torque_panel_shows_what_was_applied_over_what_was_commanded(has_effort):
    lines = torque_lines(has_effort)
    assert list(lines) == ["j, ±10", "commanded"]
    assert list(lines["j, ±10"].get_ydata()) == [-10.0] * 3
    commanded = lines["commanded"]
    assert list(commanded.get_ydata()) == [-100.0] * 3
    assert commanded.get_linestyle() == "--"
    assert commanded.get_linewidth() < lines["j, ±10"].get_linewidth()


def test_the_height_is_not_that_of_a_planogram_which_is_published_once(record):
    once = [Poses(position=[(0, 0, 9.0), (0, 0, 9.0)], orientation=[UPRIGHT] * 2)]
    planogram = {"a_planogram": ("Poses/1", ["chassis", "grasp"], once)}
    found = Devices(record(**planogram, **mobile())).height
    assert list(found.line()[1]) == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_no_legend_covers_the_curves():
    figure = Figure(layout="constrained")
    state = Signal(names=["a", "b"], steps=np.arange(3), t=np.arange(3.0),
                   fields={"position": np.zeros((3, 2)), "effort": np.ones((3, 2))})  # fmt: skip
    draw_tracking(figure, curves(Tracking(states={"a": state})))
    for axis in figure.axes:
        if axis.get_legend() is not None:
            assert axis.get_legend().get_bbox_to_anchor().x0 > axis.get_window_extent().x1


def test_the_errors_of_poses_are_those_of_the_tip_when_each_goal_ended(record):
    goals = [Goal(id=k, type="move_to_pose", tip="tip", frame="base", position=(0.5, 0.0, 0.0),
                  orientation=UPRIGHT) for k in range(2)]  # fmt: skip
    states = [GoalStatus(id=k, state="succeeded") for k in range(2)]
    half = math.radians(1.0) / 2
    turned = (0.0, 0.0, math.sin(half), math.cos(half))
    away = Poses(position=[(1, 0, 0), (1.5, 0.001, 0)], orientation=[UPRIGHT, turned])
    there = Poses(position=[(1, 0, 0), (1.5, 0, 0)], orientation=[UPRIGHT, UPRIGHT])
    recording = record(
        goal=("Goal/1", [], goals),
        status=("GoalStatus/1", [], states),
        poses=("Poses/1", ["base", "tip"], [away, there]),
    )
    first, second = pose_errors(recording)
    assert first.position == pytest.approx(0.001)
    assert first.orientation == pytest.approx(math.radians(1.0))
    assert (second.position, second.orientation) == (0.0, 0.0)
    axis = draw(lambda a: draw_pose_errors(a, [first, second]))
    assert list(axis.lines[0].get_ydata()) == pytest.approx([1.0, 0.0])


def test_a_prismatic_joint_is_plotted_in_metres_and_newtons():
    figure = Figure()
    draw_tracking(figure, curves(sliding()))
    assert [axis.get_ylabel() for axis in figure.axes] == [
        "error [rad], [m]",
        "position [rad], [m]",
        "velocity [rad/s], [m/s]",
        "torque, force [N·m], [N]",
    ]
    labels = [axis.get_legend_handles_labels()[1] for axis in figure.axes]
    assert [row[-1] for row in labels] == ["slide [m]", "slide [m]", "slide [m/s]", "slide [N]"]
