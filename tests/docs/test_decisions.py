"""The decision records are complete, numbered without gaps and listed."""

import re

import pytest
from support.paths import CHECKOUT

FOLDER = CHECKOUT / "docs/decisions"
RECORDS = sorted(path for path in FOLDER.glob("*.md") if path.name != "index.md")
SECTIONS = ["Context", "Decision", "Consequences", "Alternatives considered"]
FILE_NAME = re.compile(r"(\d{4})-[a-z0-9]+(?:-[a-z0-9]+)*\.md")
TITLE = re.compile(r"# (\d+)\. (\S.*)\n")
ENTRY = re.compile(r"^- \[(\d{4})\]\(([^)]+)\) (.+)$", re.MULTILINE)


def title_of(path):
    """Return the number and the title in the heading of a record."""
    match = TITLE.match(path.read_text(encoding="utf-8"))
    assert match is not None, f"{path.name}: begin with `# <number>. <title>`"
    return int(match[1]), match[2]


def test_the_records_are_numbered_without_gaps():
    names = [FILE_NAME.fullmatch(path.name) for path in RECORDS]
    assert [path.name for path, name in zip(RECORDS, names, strict=True) if name is None] == []
    assert [int(name[1]) for name in names] == list(range(1, len(RECORDS) + 1))
    assert [title_of(path)[0] for path in RECORDS] == list(range(1, len(RECORDS) + 1))


@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.name)
def test_every_record_has_each_section_with_text(path):
    _, *parts = re.split(r"^## ", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    headings, texts = zip(*(part.split("\n", 1) for part in parts), strict=True)
    assert list(headings) == SECTIONS
    assert [h for h, text in zip(headings, texts, strict=True) if not text.strip()] == []


def test_the_index_lists_every_record_once():
    entries = ENTRY.findall((FOLDER / "index.md").read_text(encoding="utf-8"))
    expected = [(path.name[:4], path.name, title_of(path)[1]) for path in RECORDS]
    assert sorted(entries) == expected
