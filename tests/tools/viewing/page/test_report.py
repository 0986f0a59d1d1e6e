"""The page of a run: what is in it, and what it does in a browser."""

import json
import re
import sys
import time
from pathlib import Path

import pytest
from support.messages.recordings import write
from support.pages import save_result

import stepbus
from stepbus_orchestrator.cli.entry import main
from stepbus_orchestrator.recording import Recording, TimingRecorder
from stepbus_orchestrator.run.reports import Lateness
from stepbus_participant import ExtraMissing
from stepbus_schemas import Event, JointReference, JointState, Scalars
from stepbus_tools import theme
from stepbus_tools.viewing.page import write_page

LATE = Lateness(
    factor=1.0, steps=120, p50_us=80.0, p99_us=900.0, max_us=1200.0,
    histogram={"100": 100, "1000": 19, "more": 1}, late={},
)  # fmt: skip


def state():
    return JointState(position=[0.1, 0.2], velocity=[0.0, 0.0])


def content(path):
    """Return what the script of a page shows."""
    return json.loads(re.search(r"const report = (.*?);</script>", path.read_text(), re.DOTALL)[1])


def test_charts_are_chosen_by_port_type_with_limits_and_units(recording):
    found = content(write_page([recording]))
    groups = {group["title"]: group["charts"] for group in found["groups"]}
    assert list(groups) == [
        "hip", "knee", "Base: plant.odometry", "plant.voltage (Scalars/1)",
    ]  # fmt: skip
    hip = {chart["title"]: chart for chart in groups["hip"]}
    assert (hip["position"]["unit"], hip["position"]["limits"]) == ("rad", [-1.0, 1.0])
    assert (hip["velocity"]["unit"], hip["velocity"]["limits"]) == ("rad/s", [-3.0, 3.0])
    (voltage,) = groups["plant.voltage (Scalars/1)"]
    assert [line["label"] for line in voltage["lines"]] == ["left", "right"]


def test_events_stills_and_the_path_are_there_and_texts_stay_texts(recording):
    text = write_page([recording]).read_text()
    assert text.count("data:image/png;base64") == 5
    assert "the path of the base from above" in text
    assert "<script>alert" not in text
    assert content(recording.with_name("report.html"))["marks"][0]["t"] == 1.0


def test_a_reference_may_name_some_of_the_joints(tmp_path):
    wanted = JointReference(position=[0.1], velocity=[0.0], acceleration=[0.0])
    path = write(
        tmp_path / "run.mcap",
        joint_state=("JointState/1", ["hip", "knee"], [state() for _ in range(9)]),
        reference=("JointReference/1", ["hip"], [wanted] * 9),
    )
    found = content(write_page([path]))
    groups = {group["title"]: group["charts"] for group in found["groups"]}
    assert [chart["title"] for chart in groups["hip"]] == ["error", "position", "velocity"]
    assert [chart["title"] for chart in groups["knee"]] == ["position", "velocity"]


def test_a_mission_that_ends_with_a_table_has_it_at_the_top(tmp_path):
    text = "sale  item   place\n1     cola   0.1 mm\n2     <tea>  0.2 mm\n2 of 2 sales in 9 s"
    path = write(
        tmp_path / "run.mcap",
        joint_state=("JointState/1", ["hip", "knee"], [state()] * 3),
        events=("Event/1", [], [Event(level="info", text="began"), Event(level="info", text=text)]),
    )
    page = write_page([path]).read_text()
    head, events = (
        page[: page.index("<nav")],
        page[page.index('id="happenings"') : page.index("<script>")],
    )
    assert "2     &lt;tea&gt;  0.2 mm\n2 of 2 sales in 9 s</pre>" in head
    assert "began" in events
    assert "2 of 2" not in events


def test_the_worst_joint_comes_first(tmp_path):
    wanted = JointReference(position=[0.1, 0.9], velocity=[0, 0], acceleration=[0, 0])
    path = write(
        tmp_path / "run.mcap",
        joint_state=("JointState/1", ["hip", "knee"], [state()] * 9),
        reference=("JointReference/1", ["hip", "knee"], [wanted] * 9),
    )
    titles = [group["title"] for group in content(write_page([path]))["groups"]]
    assert titles == ["Error of all joints", "knee", "hip"]


def test_joints_with_next_to_no_error_and_ports_that_stand_still_are_folded(tmp_path):
    names, zero = [f"j{number}" for number in range(7)], [0.0] * 7
    wanted = JointReference(position=[0.5, *[0.001] * 6], velocity=zero, acceleration=zero)
    path = write(
        tmp_path / "run.mcap",
        joint_state=("JointState/1", names, [JointState(position=zero)] * 9),
        reference=("JointReference/1", names, [wanted] * 9),
        still=("Scalars/1", ["volt"], [Scalars(values=[12.0])] * 9),
        moving=("Scalars/1", ["volt"], [Scalars(values=[float(n)]) for n in range(9)]),
    )
    groups = content(write_page([path]))["groups"]
    folded = [group["title"] for group in groups if not group["open"]]
    assert folded == [*names[1:], "plant.still (Scalars/1)"]


def test_a_page_names_no_folder_of_this_machine(tmp_path):
    folder = tmp_path / "runs" / "failed"
    run = ["run", "two_link", "--in-process", "--set", "duration=50ms", "--no-report"]
    assert main([*run, "--out", str(folder)]) == 0
    page = write_page([folder]).read_text()
    assert str(tmp_path) not in page
    assert "stepbus run two_link --set duration=50ms" in page
    assert "stepbus rerun failed/run.mcap" in page


def test_several_runs_share_their_charts(recording, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    write(other / "run.mcap", joint_state=("JointState/1", ["hip", "elbow"], [state(), state()]))
    assert main(["report", str(recording), str(other), "--out", str(tmp_path / "both.html")]) == 0
    groups = {group["title"]: group for group in content(tmp_path / "both.html")["groups"]}
    (position,) = [c for c in groups["hip"]["charts"] if c["title"] == "position"]
    assert [line["label"] for line in position["lines"]] == [
        f"{recording.parent.name} measured", "other measured",
    ]  # fmt: skip
    assert "elbow" in groups


def test_a_comparison_begins_with_the_largest_errors(tmp_path):
    paths = []
    for name, goal in (("a", 0.3), ("b", 0.2)):
        (tmp_path / name).mkdir()
        wanted = JointReference(position=[goal, 0.2], velocity=[0, 0], acceleration=[0, 0])
        ports = {
            "joint_state": ("JointState/1", ["hip", "knee"], [state()] * 9),
            "reference": ("JointReference/1", ["hip", "knee"], [wanted] * 9),
        }
        paths.append(write(tmp_path / name / "run.mcap", **ports))
    text = write_page(paths, tmp_path / "both.html").read_text()
    assert re.findall(r"</i>(\w+)</th>", text) == ["a", "b"]
    less = '<span class="less">(−50\u00a0%)</span>'
    assert f"<th>largest error, hip</th><td>0.2 rad</td><td>0.1 rad {less}</td>" in text
    assert "<th>largest error, knee</th><td>0 rad</td><td>0 rad</td>" in text
    assert "class=comparison" not in write_page(paths[:1]).read_text()


def test_a_comparison_says_what_each_run_was_given(tmp_path):
    paths = []
    for name, sets in (("a", []), ("b", ["kp=<60>"])):
        (tmp_path / name).mkdir()
        path = tmp_path / name / "run.mcap"
        paths.append(write(path, s=("JointState/1", ["hip"], [state()] * 9)))
        given = {"outcome": "finished", "exit_code": 0, "reason": "", "participant": ""}
        save_result(tmp_path / name, overrides=sets, **given)
    text = write_page(paths, tmp_path / "both.html").read_text()
    assert "<th>settings, faults</th><td>–</td><td>kp=&lt;60&gt;</td>" in text


@pytest.mark.parametrize("code", [99, -1, "5"])
def test_a_result_with_a_code_that_no_run_has_is_none(tmp_path, code):
    path = write(tmp_path / "run.mcap", s=("JointState/1", ["hip"], [state()] * 9))
    save_result(tmp_path, exit_code=5, reason="died")
    assert 'class="failure"' in write_page([path]).read_text()
    written = json.loads((tmp_path / "result.json").read_text())
    (tmp_path / "result.json").write_text(json.dumps({**written, "exit_code": code}))
    assert 'class="failure"' not in write_page([path]).read_text()


def test_a_failed_run_says_its_reason_first(recording, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(recording.read_bytes())
    save_result(
        tmp_path,
        reason="controller: silent for 1 s & more",
        participant="controller",
        at_step=120,
        steps=120,
        faults=["freeze controller at 110"],
        file="arm.yaml",
        overrides=["a.b=1 2"],
        real_time=LATE,
    )
    timing = TimingRecorder(tmp_path / "timing.mcap", time)
    timing.steps(
        "controller", [(step, 5_000, 250_000) for step in range(99)] + [(99, 0, 9_000_000)]
    )
    timing.close()
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "controller.log").write_text('File "/a/b/c.py", line 1\n<a> broke\n')
    text = write_page([path]).read_text()
    head = text[: text.index("<nav")]
    assert content(path.with_name("report.html"))["marks"][-1]["level"] == "failure"
    assert "--fault &#x27;freeze controller at 110&#x27;" in text
    assert "<td>controller</td><td>338 µs</td><td>250 µs</td><td>9 ms</td>" in text
    assert "p50 80 µs, p99 900 µs, max 1.2 ms" in text
    assert '<p class="where">controller failed at step 120, t = 1.200 s</p>' in head
    assert head.index("silent for 1 s &amp; more ") < head.index("exit code 4, FAULT")
    assert head.index("What to do next") < head.index('class="figures"')
    assert "A fault was injected on purpose: <code>freeze controller at 110</code>" in head
    assert "--pause-at 119</code>" in head
    assert (
        "<p>The end of controller.log:</p><pre tabindex=0>File &quot;b/c.py&quot;, line 1\n&lt;a&gt; broke"
        in head
    )
    found = content(tmp_path / "report.html")
    marks = found["marks"]
    assert found["end"] == pytest.approx(3.99)
    assert [(mark["level"], mark["t"]) for mark in marks[1:]] == [
        ("fault", pytest.approx(1.1)), ("failure", pytest.approx(1.2)),
    ]  # fmt: skip
    assert "stepbus run arm.yaml --set &#x27;a.b=1 2&#x27;" in text


def test_a_run_that_was_interrupted_says_so_and_is_no_ones_fault(recording, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(recording.read_bytes())
    save_result(
        tmp_path,
        exit_code=130,
        reason="interrupted by the user",
        participant=None,
        at_step=20,
        steps=20,
        file="arm.yaml",
    )
    head = write_page([path]).read_text().partition("<nav")[0]
    assert '<p class="where">Interrupted at step 20, t = 0.200 s</p>' in head
    assert "--pause-at" not in head
    assert ".log" not in head


def test_a_run_that_was_killed_ends_where_its_result_says(tmp_path):
    result = stepbus.run(
        "two_link",
        set=["duration=2s"],
        faults=["kill controller at 100"],
        out=tmp_path / "run",
    )
    assert (result.outcome, result.steps) == ("failed", 100)
    with Recording(tmp_path / "run") as recorded:
        assert recorded.last_whole_step == 100 < recorded.last_step
    assert "<figcaption>t = 0.50 s" in write_page([tmp_path / "run"]).read_text()


def test_a_page_that_cannot_be_written_changes_no_exit_code(tmp_path, capsys, monkeypatch):
    def full(_path, *_text, **_options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    words = ["run", "two_link", "--in-process", "--set", "duration=50ms"]
    assert main([*words, "--out", str(tmp_path / "run")]) == 0
    assert "no report " in capsys.readouterr().out
    assert not list((tmp_path / "run").glob("*report.html*"))


def test_without_its_extra_it_says_how_to_install_it(recording, monkeypatch):
    monkeypatch.setattr(theme, "find_spec", lambda _name: None)
    with pytest.raises(ExtraMissing, match=r"needs uplot, which is not installed; pip install"):
        write_page([recording])
