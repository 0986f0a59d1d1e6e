"""The Python of `make setup`, and what it installs there."""

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


def write_setup(folder, case):
    """Write what the script needs, with a Python that does what the case says with its words."""
    for name in ("scripts", ".venv/bin"):
        (folder / name).mkdir(parents=True)
    for name in ("scripts/setup_venv.sh", "pyproject.toml", "constraints.txt"):
        shutil.copyfile(CHECKOUT / name, folder / name)
    python = folder / ".venv/bin/python"
    python.write_text(f'#!/bin/sh\ncase "$*" in {case};; esac\n')
    python.chmod(0o755)


def test_a_system_without_openmp_is_told_before_the_installation(tmp_path):
    write_setup(tmp_path, "*libgomp*) exit 1")
    command = ["sh", "scripts/setup_venv.sh", "sim"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert "install the package libgomp1 (Debian, Ubuntu)" in done.stderr


def test_what_is_installed_is_not_installed_again(tmp_path):
    write_setup(tmp_path, '*install*) echo "$@" >>installed')
    for extras in ("sim,report", "sim,report", "dev", "dev", "sim,report"):
        subprocess.run(["sh", "scripts/setup_venv.sh", extras], check=True, cwd=tmp_path)
    installed = (tmp_path / "installed").read_text().splitlines()
    assert [line.split()[-1] for line in installed] == [".[sim,report]", ".[dev]"]
