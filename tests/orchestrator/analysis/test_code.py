"""What differs in scenario and files is shown as a unified diff, whatever they contain."""

import json
import time

import pytest
from support.messages.recordings import rewrite

from stepbus_orchestrator.analysis.code import changes
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode

SOME, LONG = (b"".join(b"%d\n" % number for number in range(most)) for most in (4000, 10**5))


def change(old, new):
    (found,) = changes({"a.py": old}, {"a.py": new})
    return found


@pytest.mark.parametrize(
    ("old", "new", "line", "shown"),
    [
        (b"a\nb\n", b"a\nc\n", 2, ["@@ -1,2 +1,2 @@", " a", "-b", "+c"]),
        (b"", b"a\n", 1, ["@@ -0,0 +1 @@", "+a"]),
        (b"a", b"a\n", 2, ["@@ -1,2 +1 @@", " a", "-\\ no newline at the end"]),
        (SOME, SOME.replace(b"\n500\n", b"\n"), 501, ["@@ -498,7 +498,6 @@", " 497"]),
    ],
)
def test_a_line_that_differs_is_named_and_shown(old, new, line, shown):
    found = change(old, new)
    assert found.place == f"a.py:{line}"
    assert found.diff[: 2 + len(shown)] == ["--- first/a.py", "+++ second/a.py", *shown]


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        (b"\0", b"a\n", "a.py: no text; 1 bytes in the first, 2 in the second"),
        (b"a\n", b"\xff", "a.py: no text; 2 bytes in the first, 1 in the second"),
        (LONG, LONG[::-1], "a.py:1: 100002 lines are too many for a diff"),
    ],
)
def test_what_has_no_diff_is_said_in_words(old, new, what):
    assert list(change(old, new).lines()) == [what]


def test_many_files_of_lines_that_are_alike_take_no_minutes():
    old = {str(n): b"a\nb\n" * 2000 for n in range(100)}
    began = time.monotonic()
    found = changes(old, dict.fromkeys(old, b"b\nb\na\n" * 1500))
    assert time.monotonic() - began < 20
    assert sum(bool(one.diff) for one in found) == 1


def test_a_long_line_is_cut():
    assert change(b"x" * 10**6, b"y" * 10**6).diff[3].endswith(" … (999601 more characters)")


def test_a_file_of_one_side_and_a_hostile_name(capsys):
    first, second = changes({"a\n\x1b.py": b"a"}, {"b.py": b""})
    assert (*first.lines(), *second.lines()) == (
        r"'a\n\x1b.py': only in the first (1 bytes)",
        "b.py: only in the second (0 bytes)",
    )


def test_the_command_shows_code_beside_the_first_divergence(two_link_recording, tmp_path, capsys):
    other = rewrite(two_link_recording, tmp_path / "b.mcap", 4096, attached=["files/x.py"])
    assert main(["diff", str(two_link_recording), str(other), "--code"]) == ExitCode.FINISHED
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "changed code: x.py"
    assert lines[-1] == "x.py: only in the second (1 bytes)"
    assert main(["diff", str(two_link_recording), str(other), "--code", "--json"]) == 0
    assert [one["name"] for one in json.loads(capsys.readouterr().out)["code"]] == ["x.py"]
