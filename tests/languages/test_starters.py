"""`stepbus new`: what it writes runs, in each language, in a folder of its own."""

import re
import subprocess

import pytest
from support.tools import needs, tracked

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.cli.new import STARTERS, write_starter
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.conformance import conformance

TOOLS = {"c": ("make", "cc"), "java": ("javac",), "js": ("node",), "octave": ("octave-cli",)}
# Zenoh builds for minutes, in the tests of the Rust example; Python runs in test_cli_commands.py.
QUICK = sorted(set(STARTERS) - {"python", "rust"})


@pytest.mark.parametrize("language", QUICK)
def test_a_starter_runs_as_it_is(language, tmp_path):
    needs(*TOOLS[language])
    write_starter(tmp_path / "arm", language)
    build = STARTERS[language].build.format(folder=tmp_path / "arm")
    subprocess.run(build, shell=True, check=True, capture_output=True)
    scenario = load(tmp_path / "arm", ["duration=100ms"])
    result = run(scenario, Options(out=tmp_path / "out"))
    assert (result.exit_code, result.steps, result.scenario) == (0, 20, "arm")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_python_starter_passes_the_kit_in_full(tmp_path):
    # The others are the examples of the repository, which orchestrator/conformance tests.
    bulk = ("bulk-late", "bulk-noise", "slots", "slot-stamp", "bulk-length")
    write_starter(tmp_path / "arm", "python")
    report = conformance(load(tmp_path / "arm"), "controller")
    others = {check.name: check.observed for check in report.checks if check.outcome != "pass"}
    assert others == dict.fromkeys(bulk, "it has no bulk inputs")


@pytest.mark.parametrize("language", STARTERS)
def test_a_starter_has_all_files_of_its_example(language, tmp_path):
    written = set(map(str, write_starter(tmp_path / "arm", language)))
    for _, folder, _ in STARTERS[language].parts:
        if folder.startswith("examples"):
            assert tracked(folder) <= written


@pytest.mark.parametrize("language", STARTERS)
def test_a_starter_names_no_file_outside_of_its_folder(language, tmp_path):
    for file in write_starter(tmp_path / "arm", language):
        text = (tmp_path / "arm" / file).read_text(encoding="utf-8")
        assert "package://" not in text
        if file.name in {"README.md", "Cargo.toml"}:
            assert not re.search(r"\.\./", text)


@pytest.mark.parametrize(
    ("folder", "name"),
    [("my arm/", "my_arm"), ("_1", "1"), ("...", "my_scenario"), ("a" * 70, "a" * 64)],
)
def test_the_scenario_is_called_like_its_folder(folder, name, tmp_path):
    write_starter(tmp_path / folder, "python")
    assert load(tmp_path / folder).name == name


def test_the_next_command_is_one_that_a_shell_takes(tmp_path, capsys):
    main(["new", "--language", "c", str(tmp_path / "my arm")])
    folder = f"'{tmp_path}/my arm'"
    assert f"next: make -C {folder} && stepbus run {folder}\n" in capsys.readouterr().out
