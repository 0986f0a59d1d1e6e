"""docs/guide/testing/play.md: a recording is played to the participant of a second terminal."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

from docs.test_examples import commands_in, matches
from support.paths import DOCS

from stepbus_orchestrator.errors import ExitCode

STEPBUS = Path(sys.executable).with_name("stepbus")


def start(command, folder):
    words = [STEPBUS, *shlex.split(command)[1:]]
    streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return subprocess.Popen(words, cwd=folder, text=True, **streams)


def test_the_two_terminals_show_what_the_page_says(tmp_path):
    page = (DOCS / "guide/testing/play.md").read_text()
    blocks = re.findall(r"^```console\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (record, _), (play, expected), (join, _) = (commands_in(block)[0] for block in blocks)
    with start(record, tmp_path) as recorder:
        recorder.communicate(timeout=60)
    with start(play, tmp_path) as player, start(join, tmp_path) as joined:
        shown, _ = player.communicate(timeout=60)
        assert (player.returncode, joined.wait(20)) == (ExitCode.DIFFERENT, 0), shown
    assert matches(expected, shown), shown
    assert not (tmp_path / "controller.ticket").exists()
