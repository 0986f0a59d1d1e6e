"""What a program loads and nothing names is recorded: what lies in the folder, or is declared."""

import os

import pytest
from support.runs.scenario import changed, load_text, problems_of, write
from support.tools import fake

from stepbus_orchestrator.scenario.resolve import resolved


def started(exec_, more=""):
    """Return the scenario with another program for its controller."""
    own = "controller:\n    exec: [python, -c, pass]"
    return changed(own, f"controller:\n    exec: {exec_}\n    {more}".rstrip())


def names(folder, exec_, more=""):
    return list(load_text(folder, started(exec_, more)).files)


def program(folder, name, text="", mode=0o644):
    path = write(folder, text, name)
    path.chmod(mode)
    return path


@pytest.fixture
def perl(tmp_path, monkeypatch):
    """Return a folder with a script in Perl; its interpreter is elsewhere."""
    monkeypatch.setenv("PATH", str(fake(tmp_path / ".bin", "perl")), prepend=os.pathsep)
    program(tmp_path, "c.pl")
    return tmp_path


@pytest.mark.parametrize("exec_", ["[perl, own/c.pl]", "[perl, -Ilib, own/c.pl]", "[./own/c.pl]"])
def test_what_lies_in_the_folder_of_a_script_is_recorded(perl, exec_):
    for name in ("lib/Gain/PD.pm", "own/gains.csv", "own/runs/y.pm"):
        program(perl, name)
    program(perl, "own/c.pl", "#!/usr/bin/env perl\n", 0o755)
    assert names(perl, exec_) == ["c.pl", "lib/Gain/PD.pm", "own/c.pl", "own/gains.csv"]


def test_what_is_to_be_ignored_is_not_recorded(perl):
    for name in ("PD.pm", "video/a.pm", "b.mp4", "old/sub/x.pm"):
        program(perl, name)
    program(perl, ".stepbusignore", "# large\n*.mp4\nvideo/\nold/sub\n")
    assert names(perl, "[perl, c.pl]") == ["PD.pm", "c.pl"]


def test_what_is_named_is_recorded_though_it_is_to_be_ignored(perl):
    program(perl, "build/gains.csv")
    program(perl, ".stepbusignore", "*\n")
    assert names(perl, "[perl, c.pl, build/gains.csv]") == ["build/gains.csv", "c.pl"]


def make_large(folder):
    with (folder / "large.bin").open("wb") as file:
        file.truncate((16 << 20) + 1)


def test_a_folder_with_too_much_in_it_is_told_and_only_what_is_named_is_recorded(perl):
    make_large(perl)
    scenario = load_text(perl, started("[perl, c.pl]"))
    assert list(scenario.files) == ["c.pl"]
    (sentence,) = scenario.left_out
    assert sentence.startswith(f"{perl} has more than 500 files or 16 MiB")


def test_who_declares_files_is_not_told(perl):
    make_large(perl)
    program(perl, "lib/PD.pm")
    scenario = load_text(perl, started("[perl, c.pl]", "files: [lib/]"))
    assert (list(scenario.files), list(scenario.left_out)) == (["c.pl", "lib/PD.pm"], [])


def test_declared_files_and_folders_are_recorded(tmp_path):
    for name in ("build/a.so", "build/deep/b.so", "one.log", "two.log", "notes.md"):
        program(tmp_path, name)
    assert names(tmp_path, "[sh, -c, pass]", "files: [build/, '*.log']") == [
        "build/a.so", "build/deep/b.so", "one.log", "two.log",
    ]  # fmt: skip


def test_declared_files_are_part_of_the_resolved_scenario(tmp_path):
    program(tmp_path, "build/a.so")
    text = started("[sh]", "files: [build/]")
    again = resolved(load_text(tmp_path, text))
    assert "files: [build/]" in again


def test_a_pattern_that_matches_nothing_is_a_problem(tmp_path):
    text = started("[sh]", "files: [built/]")
    assert "no file matches 'built/'" in problems_of(tmp_path, text)[0]


def test_files_of_another_folder_are_recorded_where_they_are_declared(tmp_path):
    for name in ("models/urdf/arm.urdf", "models/meshes/link.stl"):
        program(tmp_path, name)
    files = "files: ['../models']"
    assert names(tmp_path / "inner", "[sh]", files) == [
        "../models/meshes/link.stl", "../models/urdf/arm.urdf",
    ]  # fmt: skip


@pytest.mark.parametrize("exec_", ["[.venv/bin/python, c.py]", "[{folder}/.venv/bin/python, c.py]"])
def test_the_interpreter_of_a_virtual_environment_is_not_recorded(tmp_path, exec_):
    program(tmp_path, ".venv/pyvenv.cfg")
    program(tmp_path, ".venv/bin/python", "", 0o755)
    program(tmp_path, "c.py")
    assert names(tmp_path, exec_.format(folder=tmp_path)) == ["c.py"]
