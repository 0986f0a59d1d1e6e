"""The picture of a run: which panels there are, and what they show."""

import numpy as np
import pytest
from support.runs.panels import arm, curves, reference, sliding

from stepbus_schemas import BaseState, GripperState
from stepbus_tools.columns import readable
from stepbus_tools.report.charts import Chart, ChartLine, all_joints
from stepbus_tools.report.curves import PortCurves, read_ports
from stepbus_tools.report.picture import draw, port_charts
from stepbus_tools.run_lines import after_run
from stepbus_tools.signals import Signal, Tracking, read_tracking


def mobile():
    bases = [BaseState(x=0.5 * n, y=0.0, yaw=0.0, vx=1.0, wz=0.0) for n in range(4)]
    grippers = [GripperState(width=0.08, force=0.0, holding=n in {1, 2}) for n in range(4)]
    return {
        "odometry": ("BaseState/1", ["l", "r"], bases),
        "gripper": ("GripperState/1", ["a", "b"], grippers),
    }


def panels_of(tracking):
    """Return the charts of joints by the first word of their titles."""
    return {chart.title.split()[0].strip(":"): chart for chart in all_joints(curves(tracking))}


def solid(chart):
    return {line.label: line.points[1].tolist() for line in chart.lines if line.role == "measured"}


def dashed(chart):
    return {line.label: line.points[1].tolist() for line in chart.lines if line.role != "measured"}


def test_measured_values_are_drawn_over_references(record):
    states = {**arm(), "goal": ("JointReference/1", ["j"], [reference(n) for n in range(4)])}
    position = panels_of(read_tracking(record(**states)))["position"]
    assert (position.unit, list(solid(position)), list(dashed(position))) == (
        "rad",
        ["j"],
        ["reference"],
    )
    assert dashed(position)["reference"] == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_without_a_reference_the_error_is_that_of_the_motors(record):
    error = panels_of(read_tracking(record(**arm(target=[0.5]))))["error"]
    assert error.title == "error: target − measured"
    assert solid(error)["j"] == pytest.approx([0.5, 0.4, 0.3, 0.2])


def test_positions_that_are_commanded_are_not_shown_as_torques(record):
    assert list(panels_of(read_tracking(record(**arm("position"))))) == ["position", "velocity"]


@pytest.mark.parametrize("has_effort", [True, False])
def test_torques_that_were_applied_are_drawn_over_what_was_commanded(record, has_effort):
    state = {"effort": [-10.0]} if has_effort else {}
    torque = panels_of(read_tracking(record(**arm("torque", **state))))["torque"]
    expected = {"j": [-10.0] * 4, "commanded": [7.0] * 4} if has_effort else {"j": [7.0] * 4}
    assert {line.label: line.points[1].tolist() for line in torque.lines} == expected
    assert [line.role for line in torque.lines] == ["measured", "command"][: len(expected)]


def test_a_joint_that_slides_has_panels_in_metres_and_newtons():
    panels = list(all_joints(curves(sliding())))
    assert [panel.unit for panel in panels] == ["rad", "rad", "rad/s", "N·m", "m", "m", "m/s", "N"]
    assert [list(solid(panel)) for panel in panels] == [["turn"]] * 4 + [["slide"]] * 4


def test_of_very_many_joints_the_first_are_shown_and_the_title_says_so():
    names = [f"j{n}" for n in range(31)]
    fields = {"position": np.zeros((3, 31))}
    state = Signal(names=names, steps=np.arange(3), t=np.arange(3.0), fields=fields)
    (position, _) = all_joints(curves(Tracking(states={"a": state})))
    assert position.title == "position (first 20 of 31 joints)"
    assert list(solid(position)) == names[:20]


def test_a_base_and_a_gripper_have_their_numbers(record):
    recording = record(**mobile())
    ports = [PortCurves(table, 8) for table in readable(recording)[0]]
    read_ports(recording, ports)
    panels = port_charts(ports)
    assert [panel.title for panel in panels] == [
        *(f"plant.odometry: {name}" for name in ("path from above", "yaw", "vx", "wz")),
        *(f"plant.gripper: {name}" for name in ("width", "force", "holding", "slip")),
    ]
    (path,) = panels[0].lines
    assert [row.tolist() for row in path.points] == [[0.0, 0.5, 1.0, 1.5], [0.0] * 4]


@pytest.mark.slow
def test_the_picture_of_a_mobile_manipulator_is_written(record, tmp_path):
    record(**arm(target=[0.5]), **mobile())
    lines = after_run(tmp_path / "run.mcap", has_plots=True)
    assert f"plots     {tmp_path / 'report.png'}" in lines
    assert (tmp_path / "report.png").read_bytes().startswith(b"\x89PNG")


def test_a_legend_names_what_was_wanted_once_and_no_line_that_its_title_names():
    def line(label, role="measured"):
        return ChartLine(label, (np.arange(3.0), np.zeros(3)), role)

    wanted = [line("reference", "reference"), line("reference", "reference")]
    both = Chart("position", "rad", [line("a"), line("b"), *wanted])
    alone = Chart("odometry: x", "m", [line("x")])
    text = draw("a run", [both, alone], "svg").decode()
    counts = [text.count(f"<!-- {word} -->") for word in ("a", "b", "reference", "x")]
    assert counts == [1, 1, 1, 0]
