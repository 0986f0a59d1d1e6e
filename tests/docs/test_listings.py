"""The participants that the pages show pass `mypy --strict` as they stand, as a newcomer's would."""

import re
import subprocess
import sys

import pytest
from support.paths import CHECKOUT

BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
PARTICIPANT = re.compile(r"^class \w+\((?:stepbus\.)?Participant\):", re.MULTILINE)


def listings():
    """Return page → its Python up to the last block that defines a participant."""
    found = {}
    for path in [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").rglob("*.md"))]:
        blocks = BLOCK.findall(path.read_text(encoding="utf-8"))
        count = max(
            (i for i, block in enumerate(blocks, 1) if PARTICIPANT.search(block)), default=0
        )
        if count:
            name = str(path.relative_to(CHECKOUT).with_suffix("")).replace("/", "_")
            found[name] = "\n".join(blocks[:count])
    return found


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_every_participant_of_the_pages_passes_mypy_strict(tmp_path):
    pages = listings()
    assert len(pages) >= 7
    for name, text in pages.items():
        (tmp_path / f"{name}.py").write_text(
            re.sub(r"^raise SystemExit.*\n", "", text, flags=re.MULTILINE)
        )
    command = [sys.executable, "-m", "mypy", "--strict", "--no-incremental", "."]
    done = subprocess.run(
        command, check=False, cwd=tmp_path, capture_output=True, text=True, timeout=500
    )
    assert done.stdout == f"Success: no issues found in {len(pages)} source files\n"
