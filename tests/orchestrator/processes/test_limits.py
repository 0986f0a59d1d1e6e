"""Limits of this machine (ulimit): one sentence, and nothing is left behind."""

import subprocess
import sys
from pathlib import Path

import pytest

from stepbus_orchestrator.errors import ExitCode

STEPBUS = str(Path(sys.executable).with_name("stepbus"))


pytestmark = pytest.mark.usefixtures("nothing_is_left")


def limited(folder, limit, *words):
    command = f"ulimit {limit}; exec {STEPBUS} {' '.join(words)}"
    return subprocess.run(
        ["sh", "-c", command], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.parametrize("files", [6, 30, 31])
def test_too_few_open_files_are_one_sentence_before_anything_is_made(tmp_path, files):
    done = limited(tmp_path, f"-n {files}", "run", "two_link", "--no-report")
    assert done.returncode == ExitCode.START
    assert "3 participants needs 32 open files" in done.stderr
    assert f"allows {files}; raise the limit with `ulimit" in done.stderr
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_fewest_open_files_are_enough(tmp_path):
    words = ["run", "two_link", "--no-report", "--set", "duration=50ms", "--out", "run"]
    assert limited(tmp_path, "-n 32", *words).returncode == 0


@pytest.mark.parametrize("word", [b"--out=\xff", b"\xff.yaml"])
def test_a_path_that_is_no_text_is_refused(tmp_path, word):
    command = [STEPBUS.encode(), b"run", b"two_link", word]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == ExitCode.SCENARIO
    assert "is not valid UTF-8" in done.stderr
