"""What a program loads and nothing names is recorded: what lies beside it, or is declared."""

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


@pytest.mark.parametrize("exec_", ["[perl, own/c.pl]", "[perl, -w, own/c.pl]", "[./own/c.pl]"])
def test_what_lies_below_the_folder_of_a_script_is_recorded(tmp_path, monkeypatch, exec_):
    monkeypatch.setenv("PATH", str(fake(tmp_path / ".bin", "perl")), prepend=os.pathsep)
    for name in (
        "own/lib/PD.pm",
        "own/gains.csv",
        "own/.hidden/x.pm",
        "own/runs/y.pm",
        "beside.pm",
    ):
        program(tmp_path, name)
    program(tmp_path, "own/c.pl", "#!/usr/bin/env perl\n", 0o755)
    assert names(tmp_path, exec_) == ["own/c.pl", "own/gains.csv", "own/lib/PD.pm"]


def test_folders_that_a_command_line_names_are_recorded(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(fake(tmp_path / ".bin", "perl")), prepend=os.pathsep)
    for name in ("lib/Gain/PD.pm", "own/c.pl", "other/x.pm"):
        program(tmp_path, name)
    assert names(tmp_path, "[perl, -Ilib, own/c.pl]") == ["lib/Gain/PD.pm", "own/c.pl"]


def test_what_runs_have_left_and_other_scenarios_are_not_recorded(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(fake(tmp_path / ".bin", "octave-cli")), prepend=os.pathsep)
    for name in ("c.m", "+own/law.m", "data.csv", "old.mcap", "out/timing.mcap", "out/result.json"):
        program(tmp_path, name)
    program(tmp_path, "other.yaml", "participants: {}\n")
    assert names(tmp_path, "[octave-cli, --quiet, c.m]") == ["+own/law.m", "c.m", "data.csv"]


def test_a_compiled_program_takes_nothing_beside_it(tmp_path):
    path = tmp_path / "control"
    path.write_bytes(b"\x7fELF\0\0")
    path.chmod(0o755)
    program(tmp_path, "control.c")
    assert names(tmp_path, "[./control]") == ["control"]


def test_what_is_to_be_ignored_is_not_recorded(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(fake(tmp_path / ".bin", "perl")), prepend=os.pathsep)
    for name in ("c.pl", "PD.pm", "video/a.mp4", "b.mp4"):
        program(tmp_path, name)
    program(tmp_path, ".stepbusignore", "# large\n*.mp4\n")
    assert names(tmp_path, "[perl, c.pl]") == ["PD.pm", "c.pl"]


def test_a_folder_with_too_much_in_it_is_told_and_not_recorded(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(fake(tmp_path / ".bin", "perl")), prepend=os.pathsep)
    program(tmp_path, "c.pl")
    with (tmp_path / "large.bin").open("wb") as file:
        file.truncate((16 << 20) + 1)
    scenario = load_text(tmp_path, started("[perl, c.pl]"))
    assert list(files(scenario)) == ["c.pl"]
    (sentence,) = left_out(scenario)
    assert sentence.startswith(
        "what lies beside c.pl: more than 500 files, or 16 MiB; declare those"
    )


def test_a_class_path_of_java_is_recorded(tmp_path):
    for name in ("build/own/Controller.class", "lib/a.jar", "lib/notes.txt", "x.jar", "other.jar"):
        program(tmp_path, name)
    program(tmp_path, "java", "", 0o755)
    (tmp_path / "java").write_bytes(b"\x7fELF\0")
    assert names(tmp_path, "[./java, -cp, 'build:lib/*:x.jar', own.Controller]") == [
        "build/own/Controller.class", "java", "lib/a.jar", "lib/notes.txt", "x.jar",
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
