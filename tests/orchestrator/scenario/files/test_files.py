from __future__ import annotations

import pytest
from support.runs.scenario import changed, load_text, problem_of, problems_of, write

from stepbus_orchestrator.scenario import files


def with_params(params):
    return changed("law: pd", params)


def names(folder, text):
    return list(files(load_text(folder, text)))


def test_a_scenario_that_names_no_file_has_none(tmp_path):
    write(tmp_path, "", "unused.yaml")
    assert names(tmp_path, with_params("law: pd")) == []


def test_files_are_keyed_by_their_path_in_the_folder_and_sorted(tmp_path):
    write(tmp_path, "", "b.csv")
    path = write(tmp_path, "", "a/c.csv")
    found = files(load_text(tmp_path, with_params("path: b.csv, more: [{x: ./a/../a/c.csv}]")))
    assert list(found) == ["a/c.csv", "b.csv"]
    assert found["a/c.csv"].read_bytes() == path.read_bytes()


def test_yaml_and_urdf_are_read_for_further_files(tmp_path):
    write(tmp_path, "bodies: {arm: {urdf: arm.urdf}, x: {urdf: gone.urdf}}", "models/world.yaml")
    mesh = """<robot><mesh filename="m/link.stl"/><mesh filename='package://x/y.stl'/></robot>"""
    write(tmp_path, mesh, "models/arm.urdf")
    write(tmp_path, "", "models/m/link.stl")
    assert names(tmp_path, with_params("world: models/world.yaml")) == [
        "models/arm.urdf",
        "models/m/link.stl",
        "models/world.yaml",
    ]


def test_files_that_name_each_other_are_read_once(tmp_path):
    write(tmp_path, "other: b.yaml", "a.yaml")
    write(tmp_path, "other: a.yaml", "b.yaml")
    assert names(tmp_path, with_params("a: a.yaml")) == ["a.yaml", "b.yaml"]


def test_a_class_of_the_folder_brings_its_module_and_what_that_imports(tmp_path):
    write(tmp_path, "import numpy, gains\nfrom own.laws import PD\n", "law.py")
    write(tmp_path, "", "gains.py")
    write(tmp_path, "", "own/__init__.py")
    write(tmp_path, "", "own/laws.py")
    write(tmp_path, "", "unused.py")
    assert names(tmp_path, with_params("law: 'law:MyLaw'")) == [
        "gains.py", "law.py", "own/__init__.py", "own/laws.py",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "exec_", ["[python, own.py]", "[python, -m, own]", "[sh, --file=own.py]", "[./own.py]"]
)
def test_a_command_names_files_too(tmp_path, exec_):
    write(tmp_path, "", "own.py").chmod(0o755)
    text = changed("[python, -c, pass]", exec_)
    assert names(tmp_path, text) == ["own.py"]


def test_programs_may_lie_elsewhere(tmp_path):
    assert names(tmp_path, changed("[python, -c, pass]", "[/bin/sh, -c, /bin/sh]")) == []


def test_a_file_in_a_folder_beside_is_shared_by_scenarios(tmp_path):
    write(tmp_path, "<robot/>", "models/arm.urdf")
    write(tmp_path, "urdf: arm.urdf", "models/world.yaml")
    text = with_params("world: ../models/world.yaml")
    assert names(tmp_path / "inner", text) == ["../models/arm.urdf", "../models/world.yaml"]


def test_a_package_that_is_a_folder_above_is_found_by_name(tmp_path):
    mesh = '<robot><mesh filename="package://my_robot/m.stl"/></robot>'
    write(tmp_path, mesh, "my_robot/urdf/arm.urdf")
    write(tmp_path, "", "my_robot/m.stl")
    text = with_params("model: package://my_robot/urdf/arm.urdf")
    assert names(tmp_path / "scenarios/inner", text) == [
        "../../my_robot/m.stl",
        "../../my_robot/urdf/arm.urdf",
    ]


def test_an_absolute_path_out_of_the_folder_is_to_be_written_relative(tmp_path):
    path = write(tmp_path, "", "outside.csv")
    problem = problem_of(tmp_path / "inner", with_params(f"path: {path}"))
    assert problem.startswith(
        f"scenario.yaml:14: participants.controller.params.path: write '{path}' as "
        "'../outside.csv': a recording is run again from a copy of these files"
    )


def test_a_name_by_way_of_the_scenarios_own_folder_is_to_be_written_without_it(tmp_path):
    write(tmp_path, "", "inner/own.csv")
    problem = problem_of(tmp_path / "inner", with_params("path: ../inner/own.csv"))
    assert "write '../inner/own.csv' as 'own.csv'" in problem


def test_an_absolute_path_into_the_folder_is_to_be_written_relative(tmp_path):
    path = write(tmp_path, "", "own.csv")
    assert f"write '{path}' as 'own.csv'" in problem_of(tmp_path, with_params(f"path: {path}"))


def test_a_named_file_that_cannot_be_read_is_a_problem(tmp_path):
    write(tmp_path, "a: 1\nb: [1\n", "world.yaml")
    assert problem_of(tmp_path, with_params("world: world.yaml")).endswith(
        "params.world: world.yaml:3: not YAML: expected ',' or ']', but got '<stream end>'; a bracket is not closed"
    )


def test_what_cannot_be_a_file_name_is_none(tmp_path):
    long = "x" * 5000
    assert names(tmp_path, with_params(f'a: {long}, b: "\\0", c: ".", d: "", e: "x:y:z"')) == []


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("world.yaml", "a: [1", ":1: not YAML"),
        ("arm.urdf", "<robot>\n<mesh>", ":2: not XML: no element found"),
        ("law.py", "x = 1\ndef f(:", ":2: not Python: invalid syntax"),
    ],
)
def test_a_file_that_cannot_be_read_is_named_with_its_line(tmp_path, name, text, message):
    write(tmp_path, text, name)
    (found,) = problems_of(tmp_path, with_params(f"world: {name}"))
    assert f"params.world: {name}{message}" in found


def test_imports_are_found_wherever_they_stand(tmp_path):
    write(
        tmp_path, "def f():\n    from .b import x\n    import c.d as e\nfrom . import a\n", "law.py"
    )
    for name in ("a.py", "b.py", "c.py", "d.py"):
        write(tmp_path, "", name)
    assert names(tmp_path, with_params("law: 'law:Law'")) == ["a.py", "b.py", "c.py", "law.py"]
