"""The ten minutes of docs/guide/getting_started.md, as written there."""

import re

import pytest
from support.paths import DOCS
from support.tools import needs

from stepbus_orchestrator.cli.new import write_starter
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.signals import read_tracking, tracking_rmse

PAGE = (DOCS / "guide/getting_started.md").read_text(encoding="utf-8")


def shown(name: str) -> str:
    """Return the lines that the page shows for a file."""
    return re.search(rf"<!-- {name} -->\n```\w+\n(.*?)```", PAGE, re.DOTALL)[1]


def edit_octave(text: str) -> str:
    return re.sub(
        r"^ *tau = kp.*\n", lambda _: shown("controller.m"), text, count=1, flags=re.MULTILINE
    )


def edit_js(text: str) -> str:
    gains = "const { kp, kd } = gains;\n"
    text = text.replace(gains, gains + shown("controller.mjs"))
    return text.replace("const torque = kp *", "const torque = gravity[i] + kp *")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("language", "tool", "file", "edit"),
    [
        ("octave", "octave-cli", "controller.m", edit_octave),
        ("js", "node", "controller.mjs", edit_js),
    ],
)
def test_the_edit_of_the_page_takes_the_sag_away(language, tool, file, edit, tmp_path):
    needs(tool)
    write_starter(tmp_path / "my_arm", language)
    path = tmp_path / "my_arm" / file
    path.write_text(edit(path.read_text()))
    result = run(load(tmp_path / "my_arm"), Options(out=tmp_path / "out"))
    rmse = tracking_rmse(read_tracking(Recording(result.recording)))
    assert [f"{error:.3g}" for error in rmse.values()] == ["0.00785", "0.00264"]
