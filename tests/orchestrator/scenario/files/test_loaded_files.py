"""What a program loads and nothing names is recorded, by its language or as it is declared."""

import os

import pytest
from support.runs.scenario import changed, load_text, problems_of, write
from support.tools import fake

from stepbus_orchestrator.scenario import files, left_out, resolved


def started(exec_, more=""):
    """Return the scenario with another program for its controller."""
    own = "controller:\n    exec: [python, -c, pass]"
    return changed(own, f"controller:\n    exec: {exec_}\n    {more}".rstrip())


def names(folder, exec_, more=""):
    return list(files(load_text(folder, started(exec_, more))))


def program(folder, name, text="", mode=0o644):
    path = write(folder, text, name)
    path.chmod(mode)
    return path


@pytest.mark.parametrize(
    ("exec_", "script", "loaded"),
    [
        ("[perl, c.pl]", "c.pl", ["lib/Gain/PD.pm", "Old.pm"]),
        ("[perl, -Ilib, c.pl]", "c.pl", ["lib/Gain/PD.pm"]),
        ("[sh, c.sh]", "c.sh", []),
    ],
)
def test_modules_of_a_language_are_recorded(tmp_path, monkeypatch, exec_, script, loaded):
    monkeypatch.setenv("PATH", str(fake(tmp_path / ".bin", "perl")), prepend=os.pathsep)
    for name in (script, *loaded, "notes.txt", ".hidden/x.pm", "runs/y.pm"):
        program(tmp_path, name)
    assert names(tmp_path, exec_) == sorted([script, *loaded])


def test_function_files_of_octave_are_recorded(tmp_path, monkeypatch):
    for name in ("c.m", "gain.m", "+own/law.m", "data.csv"):
        program(tmp_path, name)
    monkeypatch.setenv("PATH", str(fake(tmp_path / ".bin", "octave-cli")), prepend=os.pathsep)
    assert names(tmp_path, "[octave-cli, --quiet, c.m]") == [
        "+own/law.m", "c.m", "gain.m",
    ]  # fmt: skip


def test_a_script_says_its_language_itself(tmp_path):
    program(tmp_path, "control", "#!/usr/bin/env perl\n", 0o755)
    program(tmp_path, "PD.pm")
    assert names(tmp_path, "[./control]") == ["PD.pm", "control"]


def test_a_class_path_of_java_is_recorded(tmp_path):
    for name in ("build/own/Controller.class", "lib/a.jar", "lib/notes.txt", "x.jar", "other.jar"):
        program(tmp_path, name)
    program(tmp_path, "java", "", 0o755)
    assert names(tmp_path, "[./java, -cp, 'build:lib/*:x.jar', own.Controller]") == [
        "build/own/Controller.class", "java", "lib/a.jar", "x.jar",
    ]  # fmt: skip


def test_declared_files_and_folders_are_recorded(tmp_path):
    for name in ("build/a.so", "build/deep/b.so", "one.dat", "two.dat", "readme"):
        program(tmp_path, name)
    assert names(tmp_path, "[sh, -c, pass]", "files: [build/, '*.dat']") == [
        "build/a.so", "build/deep/b.so", "one.dat", "two.dat",
    ]  # fmt: skip


def test_declared_files_are_part_of_the_resolved_scenario(tmp_path):
    program(tmp_path, "build/a.so")
    text = started("[sh]", "files: [build/]")
    again = resolved(load_text(tmp_path, text))
    assert "files: [build/]" in again


def test_a_pattern_that_matches_nothing_is_a_problem(tmp_path):
    text = started("[sh]", "files: [built/]")
    assert "no file matches 'built/'" in problems_of(tmp_path, text)[0]


def test_a_virtual_environment_is_named_and_not_recorded(tmp_path):
    program(tmp_path, ".venv/pyvenv.cfg")
    program(tmp_path, ".venv/bin/python", "", 0o755)
    program(tmp_path, "c.py")
    text = started("[.venv/bin/python, c.py]")
    scenario = load_text(tmp_path, text)
    assert list(files(scenario)) == ["c.py"]
    (sentence,) = left_out(scenario)
    assert sentence.startswith(".venv/bin/python: a virtual environment is not recorded; write its")
    absolute = load_text(tmp_path, started(f"[{tmp_path}/.venv/bin/python, c.py]"))
    assert (list(files(absolute)), left_out(absolute)) == (["c.py"], [])
