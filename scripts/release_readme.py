"""README.md as the page of the package: its relative links lead to the repository.

hatchling calls it when it builds the metadata; it is in the sdist, so that the wheel can be built
from there.
"""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

PAGES = "https://github.com/stepbus/stepbus/blob"
PICTURES = "https://raw.githubusercontent.com/stepbus/stepbus"
TARGET = r"\]\((?![a-z]+:|#)([^)\s]+)\)"
PLAIN = re.compile(rf"(!?)\[([^\[\]]*){TARGET}")
AROUND_A_PICTURE = re.compile(rf"()\[(!\[[^\[\]]*\]\([^)\s]*\)){TARGET}")


def with_addresses(text: str, version: str) -> str:
    """Return a page of Markdown whose relative links are addresses at the tag of a version."""

    def absolute(match: re.Match[str]) -> str:
        mark, label, path = match.groups()
        base = PICTURES if mark else PAGES
        return f"{mark}[{label}]({base}/v{version}/{path})"

    return AROUND_A_PICTURE.sub(absolute, PLAIN.sub(absolute, text))


class PageOfThePackage(MetadataHookInterface):
    """Sets `readme`, which pyproject.toml declares as dynamic."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add the page to the metadata."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        page = with_addresses(text, metadata["version"])
        metadata["readme"] = {"content-type": "text/markdown", "text": page}
