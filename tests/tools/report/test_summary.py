"""What the summary of a run says of its joints, and what it needs."""

import subprocess
import sys

from support.runs.panels import arm, reference, sliding

from stepbus_participant import extra_hint
from stepbus_schemas import JointState
from stepbus_tools.report.summary import read_joints, tracking_lines
from stepbus_tools.run_lines import after_run
from stepbus_tools.signals import tracking_rmse


def test_nothing_loads_matplotlib_before_it_plots():
    text = "import sys, stepbus_tools.run_lines; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", text], check=False).returncode == 0


def test_without_matplotlib_the_summary_says_what_to_install(record, tmp_path, monkeypatch):
    record(**arm(target=[0.5]))
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    line, *_ = after_run(tmp_path / "run.mcap", has_plots=True)
    assert line.startswith("no plots  a plot needs matplotlib")
    assert line.endswith("is not installed" + extra_hint("matplotlib"))


def test_a_prismatic_joint_is_summed_up_in_metres():
    tracking = sliding()
    units = {joint: tracking.unit(joint) for joint in tracking.joints}
    (rmse,) = tracking_lines(tracking_rmse(tracking, 0.0), units, 0.0)
    assert rmse.endswith("of the whole run: turn 0 rad, slide 0 m")


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
    _, (line,) = read_joints(recording)
    assert "right/j 0 rad" in line
    assert "left/j" in line


def test_the_worst_of_many_joints_is_named_for_each_unit():
    rmse = {f"j{n}": 0.01 * n for n in range(8)}
    units = {**dict.fromkeys(rmse, "rad"), "j7": "m"}
    (line,) = tracking_lines(rmse, units, 2.0)
    assert line.endswith("after 2 s: at most 60 mrad (j6), 70 mm (j7)")
