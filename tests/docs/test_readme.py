"""What the README shows is what happens."""

import re

from support.paths import CHECKOUT

from stepbus_orchestrator.cli.new import write_starter
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

README = (CHECKOUT / "README.md").read_text(encoding="utf-8")
START = (CHECKOUT / "docs/guide/getting_started.md").read_text(encoding="utf-8")


def file_of(name, page):
    """Return a file that a page shows in full."""
    return re.search(rf"<!-- {name} -->\n```\w+\n(.*?)```", page, re.DOTALL)[1]


def test_the_controller_of_the_readme_is_the_one_that_new_writes(tmp_path):
    write_starter(tmp_path / "my_arm", "python")
    controller = (tmp_path / "my_arm/controller.py").read_text(encoding="utf-8")
    assert file_of("controller.py", README) == controller


def test_the_controller_written_by_hand_drives_the_arm(tmp_path):
    for name in ("my_controller.py", "scenario.yaml"):
        (tmp_path / name).write_text(file_of(name, START))
    result = run(load(tmp_path, ["duration=500ms"]), Options(out=tmp_path / "out"))
    assert (result.exit_code, result.steps, result.drops) == (
        0, 100, {"plant": 0, "controller": 0, "mission": 0}
    )  # fmt: skip
