"""`stepbus doctor`: what it looks at, and what it says when something is wrong."""

import json
import re
import tomllib

import pytest
from support.paths import CHECKOUT

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_participant import install_command
from stepbus_plant.engines import ENGINES, is_here
from stepbus_tools import doctor
from stepbus_tools.commands import checks
from stepbus_tools.doctor import EXTRAS, Finding

PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]


@pytest.fixture(scope="module")
def findings():
    return {finding.what: finding for finding in checks.examine()}


def test_every_dependency_is_looked_at(findings):
    names = {re.match(r"[\w.-]+", row)[0].replace(".", "-") for row in PROJECT["dependencies"]}
    assert names <= {name.replace(".", "-") for name in findings}


def test_a_message_passes_over_both_transports(findings):
    assert (findings["bus, unix"].verdict, findings["bus, tcp"].verdict) == ("ok", "ok")


def test_the_physics_and_the_dynamics_can_be_loaded(findings):
    assert findings["load pin"].verdict == "ok"
    assert [findings[f"load {name}"].verdict for name in ENGINES if is_here(name)] in (
        ["ok"],
        ["ok", "ok"],
    )


def test_every_extra_that_brings_something_is_explained():
    assert set(EXTRAS) == {name for name, rows in PROJECT["optional-dependencies"].items() if rows}


def test_a_missing_extra_says_what_it_is_for_and_how_to_get_it(monkeypatch):
    monkeypatch.setattr(doctor, "needed", lambda _extra: ["no-such-package"])
    sim = next(row for row in doctor.extras() if row.what == "extra sim")
    assert sim.verdict == "warn"
    assert sim.text.endswith(f"missing no-such-package: `{install_command('sim')}`")


def test_an_extra_that_includes_another_one_lists_its_own_packages(monkeypatch):
    rows = ["numpy>=2", 'stepbus[sim]; extra == "fast"', 'ompl>=2.0; extra == "fast"']
    monkeypatch.setattr(doctor, "requires", lambda _name: rows)
    assert doctor.needed("fast") == ["ompl"]


def test_what_another_python_needs_is_not_looked_for(monkeypatch):
    rows = [
        f"{name}; {marker} and extra == 'fast'"
        for name, marker in [
            ("old", "python_version < '3.11'"),
            ("new", 'python_version >= "3.11"'),
            ("later", '(python_version >= "9.0")'),
        ]
    ]
    monkeypatch.setattr(doctor, "requires", lambda _name: rows)
    assert doctor.needed("fast") == ["new"]


def test_a_package_that_is_not_there_names_the_command_that_helps(monkeypatch):
    monkeypatch.setattr(doctor, "needed", lambda _extra="": ["no-such-package"])
    *_, found = doctor.versions()
    text = "is not installed; run `pip install 'no-such-package'`"
    assert (found.verdict, found.text) == ("fail", text)


def test_a_package_that_cannot_be_loaded_fails_with_its_last_line(monkeypatch):
    monkeypatch.setattr(doctor, "_NATIVE", {"numpy": "no_such_module"})
    (found,) = doctor.loads()
    assert found.verdict == "fail"
    assert "'no_such_module'" in found.text


def test_a_message_that_does_not_come_through_fails(monkeypatch):
    monkeypatch.setattr(doctor, "_BUS_DEADLINE_S", 0.0)
    found = doctor.link("unix")
    assert (found.verdict, "no message arrived: none within" in found.text) == ("fail", True)


@pytest.mark.parametrize(
    ("verdict", "code"), [("warn", ExitCode.FINISHED), ("fail", ExitCode.INTERNAL)]
)
def test_only_a_failure_changes_the_exit_code(monkeypatch, capsys, verdict, code):
    found = Finding("thing", verdict, "words")
    monkeypatch.setattr(checks, "examine", lambda: [found])
    assert main(["doctor", "--json"]) == code
    assert json.loads(capsys.readouterr().out) == [
        {"what": "thing", "verdict": verdict, "text": "words"}
    ]
