"""A command works where only the extra that its page names is installed."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from stepbus_participant import packages

RECORDING = Path("tests/scenarios/golden/two_link.mcap").absolute()
BROUGHT = {"report": {"PIL"}, "view": {"PIL", "websockets"}}
"""Extra → modules that matplotlib and viser need."""
HIDING = """
import sys
sys.modules.update(dict.fromkeys(sys.argv.pop(1).split(",")))
from stepbus_orchestrator.cli.entry import main
sys.exit(main(sys.argv[1:]))
"""


def with_only(extra, *words, cwd):
    """Run a command where no module of another extra can be imported."""
    kept = {*packages.EXTRAS["run"], *packages.EXTRAS[extra], *BROUGHT.get(extra, ())}
    hidden = {module for modules in packages.EXTRAS.values() for module in modules} - kept
    return subprocess.run(
        [sys.executable, "-c", HIDING, ",".join(sorted(hidden)), *words],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extra", "words", "target"),
    [
        ("report", ("report", "run.mcap"), "report.html"),
        ("report", ("plot", "run.mcap", "plant.joint_state"), "plot.png"),
        ("export", ("export", "run.mcap", "--parquet", "tables"), "tables"),
        ("view", ("export", "run.mcap", "--scene", "scene.html"), "scene.html"),
    ],
)
def test_a_command_writes_its_file_with_its_own_extra_alone(tmp_path, extra, words, target):
    shutil.copy(RECORDING, tmp_path / "run.mcap")
    done = with_only(extra, *words, cwd=tmp_path)
    assert (done.returncode, (tmp_path / target).exists()) == (0, True), done.stderr


def test_a_report_without_viser_leaves_out_its_scene_in_one_line(tmp_path):
    shutil.copy(RECORDING, tmp_path / "run.mcap")
    said = with_only("report", "report", "run.mcap", cwd=tmp_path).stderr.splitlines()
    assert len(said) == 1
    assert said[0].startswith("stepbus: the page has no animated scene")
