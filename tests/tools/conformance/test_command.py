"""`stepbus conformance`, what it prints and writes, and its page."""

import json
import re
from xml.etree import ElementTree as ET

import pytest
from support.paths import DOCS

from stepbus_orchestrator.cli import main
from stepbus_tools.commands.declared import Conformance
from stepbus_tools.conformance import CHECKS


def test_a_check_that_fails_is_in_the_json_the_junit_file_and_the_exit_code(tmp_path, capsys):
    # `true` takes part in nothing, and ends well also without a ticket.
    junit = tmp_path / "junit.xml"
    options = ["--only", "no-ticket", "--only", "join", "--json", "--junit", str(junit)]
    code = main(["conformance", *options, "--", "true"])
    report = json.loads(capsys.readouterr().out)
    cases = {case.get("name"): case for case in ET.parse(junit).getroot()}
    assert code == 11
    assert not report["conforms"]
    assert [check["outcome"] for check in report["report"]["checks"]] == ["fail", "fail"]
    assert "code 0 without a ticket" in cases["P1.1 no-ticket"].find("failure").get("message")


def test_a_program_that_conforms_exits_with_zero(capsys):
    assert main(["conformance", "--only", "no-ticket", "--participant", "mission"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "pass     no-ticket (P1.1): exited with code 2 without a ticket"
    assert lines[-1].startswith("mission conforms to protocol 2")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--only", "determinsm"], "no check 'determinsm'; did you mean 'determinism'?"),
        (["--participant", "robot"], "has no participant 'robot'"),
        (["--", "./no_such_program"], "no program './no_such_program'"),
    ],
)
def test_what_cannot_work_is_said_in_a_sentence(arguments, sentence, capsys):
    assert main(["conformance", *arguments]) == 2
    assert sentence in capsys.readouterr().err


def test_the_help_has_the_number_of_checks():
    assert f"{len(CHECKS)} checks, each of one clause" in " ".join(Conformance.__doc__.split())


def test_every_check_names_a_clause_of_the_protocol():
    clauses = set(
        re.findall(r"^- \*\*(P[\d.]+)\*\*", (DOCS / "protocol.md").read_text(), re.MULTILINE)
    )
    assert {check.clause for check in CHECKS} <= clauses


def test_the_page_has_the_checks_of_the_list(capsys):
    main(["conformance", "--list", "--json"])
    listed = [tuple(row.values()) for row in json.loads(capsys.readouterr().out)]
    page = (DOCS / "guide/testing/conformance.md").read_text()
    rows = re.findall(r"^\| `([a-z-]+)` \| (P[\d.]+) \| (.*) \|$", page, re.MULTILINE)
    assert rows == listed
