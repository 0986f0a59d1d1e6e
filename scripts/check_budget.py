"""Check the lines of Python of each package against `[tool.budget]` in pyproject.toml.

All lines count, docstrings included. The budget only falls: a package that is more than 5 % below
its entry lowers it.
"""

import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_SLACK = 0.05


def lines_of(folders: list[str]) -> int:
    """Return how many lines the Python files have that git knows below some folders."""
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "--", *folders]
    names = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.splitlines()
    files = (Path(name) for name in names if name.endswith(".py"))
    return sum(file.read_bytes().count(b"\n") for file in files if file.is_file())


def verdict(lines: int, budget: int) -> str:
    """Return what is wrong with a package; empty: nothing."""
    if lines > budget:
        return f"{lines - budget} lines too many: make it smaller"
    if lines < budget * (1 - _SLACK):
        return f"lower its entry in pyproject.toml to {lines}"
    return ""


def check(budget: Mapping[str, Mapping[str, Any]]) -> int:
    """Print the table of packages, and return the exit code."""
    code = 0
    for package, entry in budget.items():
        lines = lines_of(entry["folders"])
        problem = verdict(lines, entry["lines"])
        code = code or int(bool(problem))
        sys.stdout.write(f"{package:14} {lines:6} of {entry['lines']:6}  {problem}".rstrip() + "\n")
    return code


if __name__ == "__main__":
    settings = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))
    sys.exit(check(settings["tool"]["budget"]))
