"""`make pythons`, and the Python of `make setup`."""

import os
import shutil
import subprocess
import sys

from support.paths import CHECKOUT

from scripts import pythons

HERE = sys.version_info[:2]
FORWARD = f'#!/bin/sh\nexec {sys.executable} "$@"\n'


def program(folder, name, text):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)
    (folder / name).chmod(0o755)
    return str(folder / name)


def test_pythons_that_work_are_found_and_those_that_only_have_the_name_are_not(
    tmp_path, monkeypatch
):
    works = program(tmp_path / "bin", "python3.13", FORWARD)
    program(
        tmp_path / "bin", "python3.14", "#!/bin/sh\necho 'pyenv: command not found'\nexit 127\n"
    )
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/sbin")
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path / "none"))
    assert pythons.found((3, 11)) == {HERE: works}
    assert pythons.found((4, 0)) == {}


def test_one_of_pyenv_comes_first(tmp_path, monkeypatch):
    program(tmp_path / "bin", "python3", FORWARD)
    of_pyenv = program(tmp_path / "pyenv/versions/3.13.0/bin", "python3", FORWARD)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/sbin")
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path / "pyenv"))
    assert pythons.found((3, 11)) == {HERE: of_pyenv}


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
    assert done.stderr.startswith("PYTHON3=python2.9 does not run, or is older than Python 3.11")
    assert (tmp_path / ".venv").is_dir()
