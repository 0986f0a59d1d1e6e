"""The Python of `make setup`."""

import os
import shutil
import subprocess

from support.paths import CHECKOUT


def test_a_python_that_does_not_run_is_one_sentence_and_changes_nothing(tmp_path):
    (tmp_path / "scripts").mkdir()
    (tmp_path / ".venv").mkdir()
    shutil.copy(CHECKOUT / "scripts/setup_venv.sh", tmp_path / "scripts")
    done = subprocess.run(
        ["sh", "scripts/setup_venv.sh"],
        check=False,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHON3": "python2.9"},
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("PYTHON3=python2.9 does not run")
    assert (tmp_path / ".venv").is_dir()
