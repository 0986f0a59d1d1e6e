"""The page of a run: what is in it, and what it does in a browser."""

import json
import math
import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from support.browser import needs_chromium, opened
from support.messages.recordings import write

from stepbus_orchestrator.cli.entry import main
from stepbus_orchestrator.recording import TimingRecorder
from stepbus_orchestrator.run.reports import Lateness
from stepbus_orchestrator.run.result import Result
from stepbus_participant import ExtraMissing
from stepbus_schemas import (
    BaseState,
    Description,
    Event,
    Image,
    JointReference,
    JointState,
    Scalars,
)
from stepbus_tools.report.curves import Curve
from stepbus_tools.viewing.page import report_page, write_page

LIMITS = {"lower": [-1.0, -2.0], "upper": [1.0, 2.0], "velocity": [3.0, 3.0], "effort": [50.0, 9.0]}
STEPS = 400
LATE = Lateness(
    factor=1.0, steps=120, p50_us=80.0, p99_us=900.0, max_us=1200.0,
    histogram={"100": 100, "1000": 19, "more": 1}, late={},
)  # fmt: skip


def state(step):
    t = step / 100
    return JointState(position=[math.sin(t), math.cos(t)], velocity=[math.cos(t), -math.sin(t)])


def base(step):
    return BaseState(x=step * 0.01, y=0.1 * math.sin(step / 50), yaw=0.0, vx=1.0, wz=0.0)


def image(step):
    data = bytes([step % 256]) * (4 * 3 * 3)
    return Image(width=4, height=3, encoding="rgb8", data=data, focal=(4.0, 4.0), centre=(2.0, 1.5))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    steps = range(STEPS)
    hostile = Event(level="warning", text="</script><script>alert(1)</script>")
    return write(
        tmp_path_factory.mktemp("page") / "run.mcap",
        joint_state=(
            "JointState/1",
            Description(names=["hip", "knee"], limits=LIMITS),
            [state(step) for step in steps],
        ),
        odometry=("BaseState/1", [], [base(step) for step in steps]),
        voltage=("Scalars/1", ["left", "right"], [Scalars(values=[12.0, 11.5])] * STEPS),
        camera=("Image/1", [], [image(step) for step in steps]),
        events=("Event/1", [], [None] * 100 + [hostile]),
    )


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
    assert text.count("data:image/png;base64") == 4
    assert '<svg class="path"' in text
    assert "<script>alert" not in text
    assert content(recording.with_name("report.html"))["marks"][0]["t"] == 1.0


def test_thinning_keeps_every_peak_in_order():
    t = np.arange(100_000) * 0.01
    values = np.zeros(100_000)
    values[[7, 50_001, 99_998]] = 5.0, -7.0, 9.0
    values[30] = np.nan
    curve = Curve(2000)
    curve.add(t, values[:, None])
    few_t, few = curve.line(0)
    assert len(few) <= 2000
    assert (np.diff(few_t) >= 0).all()
    peaks = {float(x): float(y) for x, y in zip(few_t, few, strict=True) if y}
    assert peaks == {0.07: 5.0, 500.01: -7.0, 999.98: 9.0}


def test_a_reference_may_name_some_of_the_joints(tmp_path):
    wanted = JointReference(position=[0.1], velocity=[0.0], acceleration=[0.0])
    path = write(
        tmp_path / "run.mcap",
        joint_state=("JointState/1", ["hip", "knee"], [state(step) for step in range(9)]),
        reference=("JointReference/1", ["hip"], [wanted] * 9),
    )
    found = content(write_page([path]))
    groups = {group["title"]: group["charts"] for group in found["groups"]}
    assert [chart["title"] for chart in groups["hip"]] == ["error", "position", "velocity"]
    assert [chart["title"] for chart in groups["knee"]] == ["position", "velocity"]


def test_several_runs_share_their_charts(recording, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    write(other / "run.mcap", joint_state=("JointState/1", ["hip", "elbow"], [state(0), state(9)]))
    assert main(["report", str(recording), str(other), "--out", str(tmp_path / "both.html")]) == 0
    groups = {group["title"]: group for group in content(tmp_path / "both.html")["groups"]}
    (position,) = [c for c in groups["hip"]["charts"] if c["title"] == "position"]
    assert [line["label"] for line in position["lines"]] == [
        f"{recording.parent.name} measured", "other measured",
    ]  # fmt: skip
    assert "elbow" in groups


def test_a_failed_run_says_its_reason_first(recording, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(recording.read_bytes())
    Result(
        scenario="arm", outcome="failed", exit_code=4, reason="controller: silent for 1 s & more",
        participant="controller", at_step=120, steps=120, step_ns=10_000_000, seed=0, window=8,
        transport="unix", start_s=0.1, wall_s=1.0, real_time_factor=1.2, sha256="", folder=str(tmp_path),
        faults=["freeze controller at 110"], file="arm.yaml", overrides=["a.b=1 2"],
        real_time=LATE,
    ).save()  # fmt: skip
    timing = TimingRecorder(tmp_path / "timing.mcap", time)
    timing.steps(
        "controller", [(step, 5_000, 250_000) for step in range(99)] + [(99, 0, 9_000_000)]
    )
    timing.close()
    text = write_page([path]).read_text()
    head = text[: text.index("<nav")]
    assert "<td>controller</td><td>338 µs</td><td>≤ 316 µs</td><td>9 ms</td>" in text
    assert "p50 80 µs, p99 900 µs, max 1.2 ms" in text
    assert "silent for 1 s &amp; more (controller, step 120, exit code 4)" in head
    found = content(tmp_path / "report.html")
    marks = found["marks"]
    assert found["end"] == pytest.approx(3.99)
    assert [(mark["level"], mark["t"]) for mark in marks[1:]] == [
        ("fault", pytest.approx(1.1)), ("failure", pytest.approx(1.2)),
    ]  # fmt: skip
    assert "stepbus run arm.yaml --set &#x27;a.b=1 2&#x27;" in text


def test_the_charts_reach_to_what_ended_the_run(tmp_path):
    path = write(tmp_path / "run.mcap", s=("JointState/1", ["hip"], [state(0)] * 20))
    Result(
        scenario="arm", outcome="failed", exit_code=4, reason="it raised", participant="plant",
        at_step=20, steps=20, step_ns=10_000_000, seed=0, window=8, transport="unix", start_s=0.1,
        wall_s=1.0, real_time_factor=1.2, sha256="", folder=str(tmp_path),
    ).save()  # fmt: skip
    write_page([path])
    found = content(tmp_path / "report.html")
    assert found["marks"][-1]["t"] == found["end"] == pytest.approx(0.2)


def test_half_a_recording_is_shown_and_its_page_says_so(recording, tmp_path):
    data = recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    assert main(["report", str(cut)]) == 0
    text = (tmp_path / "report.html").read_text()
    assert "the recording is damaged: " in text
    assert content(tmp_path / "report.html")["groups"]


def test_what_is_no_recording_is_one_sentence(tmp_path, capsys):
    (tmp_path / "text.mcap").write_text("no recording")
    assert main(["report", str(tmp_path / "text.mcap")]) != 0
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "report.html").exists()


def test_a_page_that_cannot_be_written_changes_no_exit_code(tmp_path, capsys, monkeypatch):
    def full(_path, *_text, **_options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    words = ["run", "two_link", "--in-process", "--set", "duration=50ms"]
    assert main([*words, "--out", str(tmp_path / "run")]) == 0
    assert "no report " in capsys.readouterr().out
    assert not list((tmp_path / "run").glob("*report.html*"))


READ = """() => [...charts.values()].map(plot => ({
    points: plot.data.slice(1).map(row => row.filter(y => y !== null).length),
    x: [plot.scales.x.min, plot.scales.x.max],
    ink: (() => {
        const {width, height} = plot.ctx.canvas;
        const bytes = plot.ctx.getImageData(0, 0, width, height).data;
        return bytes.filter((value, index) => index % 4 === 3 && value > 0).length;
    })(),
}))"""


@pytest.mark.slow
@needs_chromium
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (390, True)])
def test_the_page_opens_offline_and_its_charts_zoom_together(recording, width, dark):
    with opened(write_page([recording]).as_uri(), width=width, height=2000) as watched:
        page = watched.page
        page.emulate_media(color_scheme="dark" if dark else "light")

        def drawn():
            plots = page.evaluate(READ)
            return len(plots) >= 3 and all(plot["ink"] > 1000 for plot in plots)

        def shows(first, last):
            ends = [plot["x"] for plot in page.evaluate(READ)]
            return all(end == pytest.approx([first, last], abs=0.05) for end in ends)

        watched.wait(drawn, "charts")
        assert all(sum(plot["points"]) >= STEPS for plot in page.evaluate(READ))
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        box = page.locator(".u-over").first.bounding_box()
        middle = box["y"] + box["height"] / 2
        page.mouse.move(box["x"] + box["width"] / 4, middle)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] / 2, middle, steps=5)
        page.mouse.up()
        watched.wait(lambda: shows(3.99 / 4, 3.99 / 2), "the zoom by dragging")
        page.fill("#from", "1")
        page.fill("#to", "2")
        page.dispatch_event("#to", "change")
        watched.wait(lambda: shows(1, 2), "the zoom of all charts")
        page.click("#all")
        watched.wait(lambda: shows(0, 3.99), "the whole run in all charts")
        page.click("#unit")
        watched.wait(lambda: "[°]" in page.inner_text("#charts"), "degrees")
        background = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert background == ("rgb(20, 25, 31)" if dark else "rgb(255, 255, 255)")
    assert (watched.errors, watched.strangers) == ([], [])


def test_without_its_extra_it_says_how_to_install_it(recording, monkeypatch):
    monkeypatch.setattr(report_page, "find_spec", lambda _name: None)
    with pytest.raises(ExtraMissing, match=r"needs uplot, which is not installed; pip install"):
        write_page([recording])


@pytest.mark.slow
@needs_chromium
def test_on_paper_all_charts_are_drawn_and_dots_are_dots(recording):
    with opened(write_page([recording]).as_uri(), width=1000, height=600) as watched:
        page = watched.page
        page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = false })")
        page.pdf()
        charts, drawn = (
            page.locator(f"#charts {what}").count() for what in (".chart", ".chart canvas")
        )
        assert charts == drawn > 5
        assert page.locator("#charts details[open]").count() == 0
        effects = page.locator("svg.path circle").evaluate_all(
            "all => all.map(one => getComputedStyle(one).vectorEffect)"
        )
        assert effects == ["non-scaling-stroke"] * 2
        assert not watched.errors
