"""The plots of a run: which panels there are, and what they show."""

import math
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from matplotlib.figure import Figure
from support.messages.recordings import write

from stepbus_orchestrator.analysis.report import write_report
from stepbus_orchestrator.analysis.report.curves.curve import Curve
from stepbus_orchestrator.analysis.report.curves.devices import Devices
from stepbus_orchestrator.analysis.report.curves.pose_errors import draw_pose_errors, pose_errors
from stepbus_orchestrator.analysis.report.curves.tracking import TrackingCurves
from stepbus_orchestrator.analysis.report.panels.devices import device_panels, holding_spans
from stepbus_orchestrator.analysis.report.panels.joints import draw_panels
from stepbus_orchestrator.analysis.report.panels.tracking import (
    draw_error,
    draw_torque,
    draw_tracking,
)
from stepbus_orchestrator.analysis.report.report import draw_report
from stepbus_orchestrator.analysis.report.summary import Summary
from stepbus_orchestrator.analysis.signals import Signal, Tracking, read_tracking, tracking_pieces
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.reader import source
from stepbus_participant import extra_hint
from stepbus_schemas import (
    BaseState,
    Goal,
    GoalStatus,
    GripperState,
    JointCommand,
    JointReference,
    JointState,
    Poses,
)

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def record(tmp_path):
    """Return a function that records ports: name → type, names, messages."""
    return lambda **ports: Recording(write(tmp_path / "run.mcap", **ports))


def arm(mode="position", **state):
    states = [JointState(position=[0.1 * n], velocity=[0.0], **state) for n in range(4)]
    commands = [JointCommand(mode=mode, values=[7.0]) for _ in range(4)]
    return {
        "arm": ("JointState/1", ["j"], states),
        "command": ("JointCommand/1", ["j"], commands),
    }


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


def curves(*pieces):
    found = TrackingCurves()
    for piece in pieces:
        found.take(piece)
    return found


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


def curve(count, piece, columns=1, **options):
    """Return a curve of random walks, added piece by piece, with their times and values."""
    t = np.arange(float(count))
    values = np.random.default_rng(count).normal(size=(count, columns)).cumsum(axis=0)
    found = Curve(**options)
    for start in range(0, count, piece):
        found.add(t[start : start + piece], values[start : start + piece])
    return found, t, values


def test_a_line_of_up_to_8000_points_is_all_there():
    found, t, values = curve(8000, 700)
    assert (found.line(0)[0] == t).all()
    assert (found.line(0)[1] == values[:, 0]).all()


@pytest.mark.parametrize("count", [8001, 30_011, 200_000])
@pytest.mark.parametrize("piece", [1777, 200_000])
@pytest.mark.parametrize("together", [False, True])
def test_a_long_line_keeps_its_extremes_in_their_order(count, piece, together):
    found, _, values = curve(count, piece, columns=2, together=together)
    for index in (0, 1):
        thin, kept = found.line(index)
        assert 2000 <= len(thin) <= 9000
        assert (np.diff(thin) >= 0).all()
        assert (kept == values[thin.astype(int), index]).all()
        assert (kept.min(), kept.max()) == (values[:, index].min(), values[:, index].max())
    if together:
        assert (found.line(0)[0] == found.line(1)[0]).all()


def test_a_single_spike_in_a_long_line_is_shown():
    values = np.zeros((100_000, 1))
    values[777] = 5.0
    found = Curve()
    found.add(np.arange(100_000.0), values)
    assert found.line(0)[1].max() == 5.0


def test_the_lines_of_several_pieces_are_those_of_one(record):
    recording = record(
        arm=("JointState/1", ["j"], [JointState(position=[math.sin(n)]) for n in range(50)]),
        goal=("JointReference/1", ["j"], [reference(n) if n % 5 == 2 else None for n in range(45)]),
        command=(
            "JointCommand/1",
            ["j"],
            [JointCommand(mode="torque", values=[n]) for n in range(9)],
        ),
    )
    whole, cut = (curves(*tracking_pieces(recording, size)) for size in (10**9, 60))
    assert len(list(tracking_pieces(recording, 60))) > 10
    for found in ("position", "velocity"):
        assert np.array_equal(lines(whole, found), lines(cut, found), equal_nan=True)
    assert np.array_equal(whole.error("j"), cut.error("j"), equal_nan=True)
    assert np.array_equal(whole.torques[0].of("values", "j"), cut.torques[0].of("values", "j"))
    assert np.allclose(
        whole.state_of("j").slope("j"), cut.state_of("j").slope("j"), atol=1e-12, rtol=0
    )


def reference(n):
    return JointReference(position=[0.1 * n], velocity=[1.0 * n], acceleration=[0.0])


def lines(found, quantity):
    return found.reference_of("j").of(quantity, "j")


def test_a_report_takes_as_much_memory_for_a_long_recording_as_for_a_short_one(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(source, "_CACHE_BYTES", 500_000)
    peaks = []
    for count in (20_000, 60_000):
        states = [JointState(position=[math.sin(0.01 * n)], target=[0.0]) for n in range(count)]
        path = write(tmp_path / f"{count}.mcap", arm=("JointState/1", ["j"], states))
        del states
        peaks.append(peak_of_a_report(path))
    assert peaks[1] < peaks[0] + 1_000_000


def peak_of_a_report(path):
    """Return the most memory [bytes] that reading a recording for its report takes."""
    with Recording(path) as recording:
        tracemalloc.start()
        found, summary = TrackingCurves(), Summary()
        for piece in tracking_pieces(recording, 200_000):
            found.take(piece)
            summary.take(piece)
        summary.lines(tracking_pieces(recording, 200_000))
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    return peak


def test_the_summary_names_the_worst_of_many_joints():
    steps, names = np.arange(400), [f"j{n}" for n in range(7)]
    t, zero = steps * 0.01, np.zeros((400, 7))
    offset = zero + 0.01 * np.arange(7)
    state = Signal(names=names, steps=steps, t=t, fields={"position": offset})
    reference = Signal(names=names, steps=steps, t=t, fields={"position": zero})
    summary, tracking = Summary(), Tracking(states={"a": state}, references={"b": reference})
    summary.take(tracking)
    assert summary.lines([tracking]) == ["tracking RMSE after 2 s: at most 0.06 rad (j6)"]


def test_nothing_loads_matplotlib_before_it_plots():
    text = "import sys, stepbus_orchestrator.analysis.report; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", text], check=False).returncode == 0


def test_without_matplotlib_the_summary_says_what_to_install(record, tmp_path, monkeypatch):
    record(**arm(target=[0.5]))
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    monkeypatch.setitem(sys.modules, "matplotlib.backends.backend_agg", None)
    (line,) = write_report(tmp_path / "run.mcap")
    assert line.startswith("no plots  matplotlib")
    assert line.endswith("is not installed" + extra_hint("matplotlib"))


def sliding():
    """Return a recording of an arm whose joint `slide` follows 0.1 m · sin t, and `turn` 0.1 rad."""
    steps = np.arange(2000)
    t = steps * 0.005
    wave = 0.1 * np.sin(t)[:, None] * np.ones((1, 2))
    names, types = ["turn", "slide"], {"turn": "revolute", "slide": "prismatic"}
    state = Signal(names=names, steps=steps, t=t, fields={"position": wave}, joint_types=types)
    wanted = {"position": wave, "velocity": wave, "acceleration": -wave}
    reference = Signal(names=names, steps=steps, t=t, fields=wanted)
    command = Signal(
        names=names, steps=steps, t=t, fields={"values": wave}, modes=frozenset({"torque"})
    )
    return Tracking(states={"a": state}, references={"b": reference}, commands={"c": command})


def test_a_prismatic_joint_is_summed_up_in_metres():
    summary, tracking = Summary(), sliding()
    summary.take(tracking)
    turn, slide, rmse = summary.lines([tracking])
    assert turn.startswith("sinusoid  turn: 5.730° of 5.730°")
    assert slide.startswith("sinusoid  slide: 0.100000 m of 0.100000 m")
    assert rmse == "tracking RMSE after 2 s: turn 0 rad, slide 0 m"


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


def test_two_plants_with_a_reference_each_are_both_summed_up(record):
    times = [0.1 * n for n in range(40)]
    states = [JointState(position=[0.1], velocity=[0.0]) for _ in times]
    wanted = [reference(1) for _ in times]
    recording = record(
        left=("JointState/1", ["left/j"], states),
        right=("JointState/1", ["right/j"], states),
        filtered=("JointState/1", ["left/j"], [JointState(position=[9.0]) for _ in times]),
        one=("JointReference/1", ["right/j"], wanted),
        other=("JointReference/1", ["left/j"], wanted),
    )
    summary = Summary()
    for piece in tracking_pieces(recording, 500):
        summary.take(piece)
    (line,) = summary.lines(tracking_pieces(recording, 500))
    assert "right/j 0 rad" in line
    assert "left/j" in line


def test_the_worst_of_many_joints_is_named_for_each_unit():
    steps, names = np.arange(400), [f"j{n}" for n in range(8)]
    offset = np.zeros((400, 8)) + 0.01 * np.arange(8)
    types = {"j7": "prismatic"}
    state = Signal(
        names=names, steps=steps, t=steps * 0.01, fields={"position": offset}, joint_types=types
    )
    wanted = Signal(names=names, steps=steps, t=steps * 0.01, fields={"position": 0 * offset})
    summary, tracking = Summary(), Tracking(states={"a": state}, references={"b": wanted})
    summary.take(tracking)
    (line,) = summary.lines([tracking])
    assert line == "tracking RMSE after 2 s: at most 0.06 rad (j6), 0.07 m (j7)"
