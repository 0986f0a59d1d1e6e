"""The picture of the wiring: the same each time, readable, and safe whoever wrote the scenario."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import pytest

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.cli.new import STARTERS
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import ExtraMissing
from stepbus_schemas import SHIPPED, Description, WiringError
from stepbus_tools import wiring
from stepbus_tools.viewing.page import write_page
from stepbus_tools.wiring import draw_wiring, recorded_wiring

RECORDING = Path("tests/scenarios/golden/two_link.mcap").absolute()
HOSTILE = '</title><script>alert(1)</script>"]; click p0 call x() %% `__<img src=x onerror=y>'
KEPT = '<br/>▸ kept: Imu/1 (rad/s, m/s²; not recorded)"]'


def scenario(types=("JointState/1",), **changed):
    """Return the data of a scenario: each participant reads the one before."""
    rows = {
        f"stage_{n}": {
            "exec": ["true"],
            "inputs": {"given": f"stage_{n - 1}.made"} if n else {},
            "outputs": {"made": kind, "kept": {"type": "Imu/1", "record": "off"}},
        }
        for n, kind in enumerate(types)
    }
    return {"name": "chain", "step": "2ms", "participants": rows, **changed}


def svg(data, tmp_path):
    draw_wiring(data, {}, tmp_path / "wiring.SVG")
    return (tmp_path / "wiring.SVG").read_text(encoding="utf-8")


def recorded(data):
    return recorded_wiring(SimpleNamespace(scenario=data, ports={}, types=SHIPPED))


def test_text_and_picture_have_ports_types_units_rates_order_and_what_is_recorded(tmp_path):
    data = scenario(["JointState/1", "Wrench/1"])
    given = {"from": "stage_0.made", "delay": 2}
    data["participants"]["stage_1"] |= {"every": 5, "inputs": {"given": given}}
    text = draw_wiring(data, {"stage_1": {"made": Description(units={"force": "kN"})}})
    assert "\n".join(text.splitlines()[3:]) == (
        f'  p0["1 · stage_0<br/>every 2 ms<br/>▸ made: JointState/1 (rad, rad/s, N·m){KEPT}\n'
        '  p1["2 · stage_1<br/>every 10 ms (5 steps)<br/>◂ given from stage_0.made, '
        f"2 steps old<br/>▸ made: Wrench/1 (kN, N·m){KEPT}\n"
        "  p0 -.-> p1"
    )
    words = {*ET.fromstring(svg(data, tmp_path)).itertext()}
    assert {"1 · stage_0", "every 10 ms (5 steps)", "from stage_0.made, 2 steps old"} <= words
    assert {"Wrench/1", "rad, rad/s, N·m", "rad/s, m/s²; not recorded"} <= words


def test_it_is_the_same_each_time_and_of_a_recording(tmp_path):
    first = svg(load("two_link"), tmp_path)
    assert svg(load("two_link"), tmp_path) == first
    with Recording(RECORDING) as recording:
        assert re.sub("<style>.*?</style>", "", first) in recorded_wiring(recording)


@pytest.mark.parametrize("is_chain", [True, False])
def test_twelve_participants_fit_into_1280_pixels(tmp_path, is_chain):
    data = scenario(["JointState/1"] * 12)
    for row in list(data["participants"].values())[1:]:
        row["inputs"] = row["inputs"] if is_chain else {"given": "stage_0.made"}
    text = svg(data, tmp_path)
    assert int(re.search(r'width="(\d+)"', text)[1]) < 1280
    assert set(re.findall(r'font-size="(.*?)"', text)) == {"10", "12"}


def test_names_of_a_hostile_scenario_are_text(tmp_path):
    data = scenario([HOSTILE])
    assert not re.search('script>|<img|"];|`|__', draw_wiring(data, {}))
    page = recorded(data)
    assert not re.search("<script|<img", page)
    assert HOSTILE in [*ET.fromstring(page).itertext()]


def test_a_picture_that_is_no_svg_is_refused(tmp_path):
    with pytest.raises(WiringError, match=r"wiring\.svg$"):
        draw_wiring(load("two_link"), {}, tmp_path / "wiring.png")


def test_nothing_is_loaded_that_a_recorded_scenario_names():
    assert "stage_0" in recorded(scenario(types="antigravity"))
    assert "antigravity" not in sys.modules
    assert "It cannot be drawn: step" in recorded(scenario(step="<b>"))
    with pytest.raises(WiringError, match="too many for a picture"):
        draw_wiring(scenario(["JointState/1"] * 200), {})


def test_without_graphviz_the_text_is_there_and_a_report_says_why(tmp_path, monkeypatch):
    monkeypatch.setattr(wiring, "files", lambda _: [])
    assert draw_wiring(scenario(), {}).count("stage_0") == 1
    with pytest.raises(ExtraMissing, match=r"needs graphviz-pure, .*pip install 'stepbus\[report"):
        svg(scenario(), tmp_path)
    page = write_page([RECORDING], tmp_path / "report.html").read_text(encoding="utf-8")
    assert "the picture of the wiring needs graphviz-pure" in page


@pytest.mark.parametrize("language", STARTERS)
def test_a_new_scenario_has_it_in_its_readme(tmp_path, language, capsys):
    assert main(["new", str(tmp_path / "mine"), "--language", language]) == 0
    readme = (tmp_path / "mine/README.md").read_text(encoding="utf-8")
    assert readme.count("```mermaid\n%%{init") == readme.count("· controller<br/>every 5 ms") == 1
