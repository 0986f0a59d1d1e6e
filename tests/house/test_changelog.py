import re
import subprocess
import sys
from pathlib import Path

import pytest
from support.paths import CHECKOUT
from support.tools import needs

SCRIPT = CHECKOUT / "scripts/check_changelog.py"
SECTIONS = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
"""Those of Keep a Changelog."""
LONGEST = 130


def _releases() -> dict[str, str]:
    """Return the text below the heading of each version, the newest first."""
    text = (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8")
    _, *parts = re.split(r"^## ", text, flags=re.MULTILINE)
    return {heading: body for heading, _, body in (part.partition("\n") for part in parts)}


def _git(folder: Path, *arguments: str) -> None:
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    subprocess.run(["git", "-C", str(folder), *who, *arguments], check=True, capture_output=True)


def _check(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(SCRIPT)], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    needs("git")
    (tmp_path / "schemas").mkdir()
    (tmp_path / "schemas/code.py").write_text("one = 1\n")
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## Unreleased\n\n- one\n\n## 0.1\n")
    _git(tmp_path, "init", "-b", "main")
    _git(tmp_path, "add", ".")
    _git(tmp_path, "commit", "-m", "one")
    return tmp_path


def test_a_checkout_without_changes_needs_no_changelog_line(checkout: Path) -> None:
    assert _check(checkout).returncode == 0


def test_a_change_of_the_code_needs_a_changelog_line(checkout: Path) -> None:
    (checkout / "schemas/new.py").write_text("two = 2\n")
    done = _check(checkout)
    assert done.returncode == 1
    assert "1 code files changed (schemas/new.py …); add a line" in done.stderr


def test_a_line_under_another_heading_does_not_count(checkout: Path) -> None:
    (checkout / "schemas/code.py").write_text("one = 2\n")
    with (checkout / "CHANGELOG.md").open("a") as changelog:
        changelog.write("\n- in the wrong place\n")
    assert _check(checkout).returncode == 1


def test_a_branch_is_compared_with_where_it_left_main(checkout: Path) -> None:
    _git(checkout, "switch", "-c", "topic")
    (checkout / "schemas/code.py").write_text("one = 2\n")
    _git(checkout, "commit", "-a", "-m", "two")
    assert _check(checkout).returncode == 1


def test_a_changelog_line_settles_it(checkout: Path) -> None:
    (checkout / "schemas/code.py").write_text("one = 2\n")
    (checkout / "CHANGELOG.md").write_text("# Changelog\n\n## Unreleased\n\n- two\n- one\n")
    assert _check(checkout).returncode == 0


def test_files_without_history_are_not_compared(tmp_path: Path) -> None:
    assert _check(tmp_path).returncode == 0


def test_each_release_has_a_version_and_a_date() -> None:
    first, *released = _releases()
    assert first == "Unreleased"
    form = re.compile(r"\d+\.\d+\.\d+ - \d{4}-\d\d-\d\d")
    assert [heading for heading in released if not form.fullmatch(heading)] == []


def test_a_release_lists_short_entries_in_the_usual_sections() -> None:
    _, *released = _releases().items()
    for version, body in released:
        sections = re.findall(r"^### (.+)$", body, re.MULTILINE)
        assert sections, version
        assert set(sections) <= SECTIONS, version
        below = body[body.index("### ") :].splitlines()
        entries = [line for line in below if line and not line.startswith("### ")]
        assert [e for e in entries if not e.startswith("- ") or len(e) > LONGEST] == []
