"""Limits of this machine (ulimit): one sentence, and nothing is left behind."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from stepbus_orchestrator.errors import ExitCode, StartFailed
from stepbus_orchestrator.processes.launcher import Launcher

STEPBUS = str(Path(sys.executable).with_name("stepbus"))


pytestmark = pytest.mark.usefixtures("nothing_is_left")


@pytest.mark.parametrize("word", [b"--out=\xff", b"\xff.yaml"])
def test_a_path_that_is_no_text_is_refused(tmp_path, word):
    command = [STEPBUS.encode(), b"run", b"two_link", word]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == ExitCode.SCENARIO
    assert "is not valid UTF-8; if it is valid in your terminal" in done.stderr


def test_without_a_reaper_the_private_folder_goes(monkeypatch, tmp_path):
    """`rmtree` opens the folder; that fails with the error for which the reaper did not start."""

    def refuse(*_args, **_options):
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    monkeypatch.setattr(shutil, "rmtree", refuse)
    with pytest.raises(StartFailed, match=r"cannot start the reaper, .*: Too many open"):
        Launcher(run="r", token="t", logs=tmp_path)
