"""Exports and reports from Python: what the command line writes."""

import sys
from types import SimpleNamespace

import av
import polars as pl
import pytest

import stepbus
from stepbus_orchestrator.cli import main
from stepbus_tools.exporters import Exporter
from stepbus_tools.viewing.exports import Exported


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    out = tmp_path_factory.mktemp("exports") / "run"
    return stepbus.run("two_link", set={"duration": "100ms"}, out=out, in_process=True)


@pytest.mark.slow
def test_an_export_is_what_the_command_writes(result, tmp_path):
    done = stepbus.export(result, parquet=tmp_path / "tables", csv=str(tmp_path / "all.csv"))
    assert list(done) == ["parquet", "csv"]
    assert done["csv"].paths == [tmp_path / "all.csv"]
    assert tmp_path / "tables/plant.joint_state.parquet" in done["parquet"].paths
    assert pl.read_parquet(tmp_path / "tables/plant.joint_state.parquet")["t"][-1] == 0.1
    assert main(["export", str(result.folder), "--csv", str(tmp_path / "other.csv")]) == 0
    assert (tmp_path / "other.csv").read_bytes() == (tmp_path / "all.csv").read_bytes()


def test_a_film_of_a_part_has_its_rate(result, tmp_path):
    film = tmp_path / "a.mp4"
    stepbus.export(result, video=film, fps=50, from_="20ms", to="60ms", size="64x48")
    with av.open(str(film)) as container:
        frames = [frame.time for frame in container.decode(video=0)]
    assert frames == pytest.approx([0.0, 0.02, 0.04])


def test_an_export_says_what_is_missing(result, tmp_path):
    half, data = tmp_path / "half.mcap", result.recording.read_bytes()
    half.write_bytes(data[: len(data) * 3 // 4])
    (done,) = stepbus.export(half, csv=tmp_path / "csv").values()
    assert "is damaged" in done.problems[-1]
    (done,) = stepbus.export(result.folder, ros2=tmp_path / "a.mcap").values()
    assert any("ROS 2 has no type" in line for line in done.problems)


def test_an_export_to_nowhere_and_of_nothing_is_an_error(result, tmp_path):
    with pytest.raises(stepbus.WiringError, match="give a target"):
        stepbus.export(result)
    with pytest.raises(stepbus.WiringError, match=r"write \.mp4 or \.gif"):
        stepbus.export(result, video=tmp_path / "film.avi")
    with pytest.raises(stepbus.errors.RecordingFailed):
        stepbus.export(tmp_path / "no.mcap", csv=tmp_path / "csv")


def test_a_package_may_add_a_form(result, tmp_path, monkeypatch):
    def write_count(recording, target, reached, *, unit=""):
        target.write_text(f"{recording.last_step} {unit}")
        return Exported(paths=[target])

    monkeypatch.setitem(sys.modules, "counting", SimpleNamespace(write_count=write_count))
    options = {"unit": ("UNIT", "")}
    exporter = Exporter(write="counting:write_count", help="how many steps", options=options)
    monkeypatch.setattr(
        "stepbus_tools.exporters.named_points",
        lambda group: {"count": SimpleNamespace(load=lambda: exporter)},
    )
    (done,) = stepbus.export(result, count=tmp_path / "count.txt").values()
    assert done.paths[0].read_text() == "20 "
    with pytest.raises(stepbus.WiringError, match="did you mean 'count'"):
        stepbus.export(result, coun=tmp_path / "count.txt")


@pytest.mark.slow
def test_a_run_writes_its_page_when_it_is_told_to(result, tmp_path):
    assert not result.recording.with_name("report.html").exists()
    other = stepbus.run(
        "two_link", set={"duration": "50ms"}, out=tmp_path / "run", in_process=True, report=True
    )
    assert "It finished." in other.recording.with_name("report.html").read_text()
    both = stepbus.report(result, other, out=tmp_path / "both.html")
    assert both == tmp_path / "both.html"
    assert "comparison" in both.read_text()
    assert stepbus.report(result) == result.recording.with_name("report.html")
    with pytest.raises(stepbus.WiringError, match="give a recording"):
        stepbus.report()


def test_a_page_that_cannot_be_written_is_a_warning_and_the_run_has_its_result(
    tmp_path, monkeypatch
):
    def fail(paths):
        raise stepbus.errors.RecordingFailed(f"{paths[0]}: no space")

    monkeypatch.setattr("stepbus_tools.viewing.page.write_page", fail)
    with pytest.warns(UserWarning, match=r"no report: .*run\.mcap: no space"):
        done = stepbus.run(
            "two_link", set={"duration": "50ms"}, out=tmp_path / "a", in_process=True, report=True
        )
    assert done.outcome == "finished"
