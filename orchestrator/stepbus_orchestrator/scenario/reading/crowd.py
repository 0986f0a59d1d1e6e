"""Refuses a scenario of more participants than a run can have, before it is read as a whole."""

import re
from pathlib import Path

from stepbus_participant import read_text
from stepbus_participant.parameters import YamlFile, fatal

MOST_PARTICIPANTS = 1000
"""Any two have a link, and each participant is a process."""

_PARTICIPANTS = re.compile(r"^participants:[ \t]*(#.*)?$", re.MULTILINE)
_FIRST = re.compile(r"\A(?:[ \t]*(?:#.*)?\n)*( +)\S")


def refuse_crowd(path: Path) -> None:
    """Raise SettingsError for a file with too many participants; what is no such file passes.

    It counts lines, which takes milliseconds; to read 10,000 participants as YAML takes seconds.
    """
    try:
        text = read_text(path, "utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return
    start = _PARTICIPANTS.search(text)
    if start is None:
        return
    # From the line on that is less indented, it is about something else.
    block = re.split(r"^[^\s#]", text[start.end() + 1 :], maxsplit=1, flags=re.MULTILINE)[0]
    first = _FIRST.match(block)
    if first is None:
        return
    keys = re.findall(rf"^{first[1]}[A-Za-z0-9\"'][^:\n]*:", block, re.MULTILINE)
    _check(len(keys), path.name, text.count("\n", 0, start.start()) + 1)


def check_count(document: YamlFile) -> None:
    """Raise SettingsError for too many participants, however they are written."""
    participants = document.data.get("participants")
    if isinstance(participants, dict):
        place = document.places.get(("participants",))
        _check(len(participants), document.file, 0 if place is None else place.line)


def _check(count: int, file: str, line: int) -> None:
    if count > MOST_PARTICIPANTS:
        text = f"has {count} participants; a run has at most {MOST_PARTICIPANTS}"
        raise fatal(file, text, line)
