from __future__ import annotations

import pytest
from support.runs.scenario import changed, load_text, problem_of, write


def with_params(params):
    return changed("law: pd", params)


def names(folder, text):
    return list(load_text(folder, text).files)


def test_files_are_keyed_by_their_path_in_the_folder_and_sorted(tmp_path):
    write(tmp_path, "", "b.csv")
    path = write(tmp_path, "", "a/c.csv")
    found = load_text(tmp_path, with_params("path: b.csv, more: [{x: ./a/../a/c.csv}]")).files
    assert list(found) == ["a/c.csv", "b.csv"]
    assert found["a/c.csv"].read_bytes() == path.read_bytes()


def test_all_that_lies_in_the_folder_is_recorded(tmp_path):
    everything = ["gains.csv", "models/arm.urdf", "models/m/link.stl", "own/laws.py"]
    for name in everything:
        write(tmp_path, "", name)
    assert names(tmp_path, with_params("law: pd")) == everything


def test_what_runs_have_left_and_other_scenarios_do_not_belong_to_it(tmp_path):
    own = ("law.py", "data.yaml", "sub/x.csv")
    others = (
        "old.mcap", "out/timing.mcap", "out/result.json", "runs/a/b.csv", "s/sweep.json", "s/x.csv",
        "run.log", "README.md", ".hidden/x.py", ".env", "__pycache__/law.pyc", "build/x.o",
        "venv/pyvenv.cfg", "venv/lib/x.py",
    )  # fmt: skip
    for name in (*own, *others):
        write(tmp_path, "", name)
    write(tmp_path, "participants: {}\n", "other.yaml")
    assert names(tmp_path, with_params("law: 'law:MyLaw'")) == sorted(own)


@pytest.mark.parametrize("exec_", ["[python, own.py]", "[python, -m, own]", "[./own.py]"])
def test_a_command_names_files_too(tmp_path, exec_):
    write(tmp_path, "", "own.py").chmod(0o755)
    text = changed("[python, -c, pass]", exec_)
    assert names(tmp_path, text) == ["own.py"]


def test_programs_may_lie_elsewhere(tmp_path):
    assert names(tmp_path, changed("[python, -c, pass]", "[/bin/sh, -c, /bin/sh]")) == []


def test_a_file_in_another_folder_is_recorded_alone(tmp_path):
    for name in ("models/urdf/arm.urdf", "models/meshes/link.stl", "unused.csv"):
        write(tmp_path, "", name)
    text = with_params("world: ../models/urdf/arm.urdf")
    assert names(tmp_path / "inner", text) == ["../models/urdf/arm.urdf"]


@pytest.mark.parametrize(
    ("file", "given", "better"),
    [
        ("outside.csv", "{folder}/outside.csv", "../outside.csv"),
        ("inner/own.csv", "../inner/own.csv", "own.csv"),
        ("inner/own.csv", "{folder}/inner/own.csv", "own.csv"),
    ],
)
def test_a_path_that_a_copy_does_not_have_is_to_be_written_otherwise(tmp_path, file, given, better):
    write(tmp_path, "", file)
    given = given.format(folder=tmp_path)
    problem = problem_of(tmp_path / "inner", with_params(f"path: {given}"))
    assert problem.startswith("scenario.yaml:14: ")
    assert f"write '{given}' as '{better}'" in problem


def test_what_cannot_be_a_file_name_is_none(tmp_path):
    long = "x" * 5000
    assert names(tmp_path, with_params(f'a: {long}, b: "\\0", c: ".", d: "", e: "x:y:z"')) == []
