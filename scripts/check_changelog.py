"""Check that a change of the code comes with a line in CHANGELOG.md.

Compared are the files here and those where this branch left the main one; on the main branch, and
without one, those of the last commit. It needs no remote: in a fresh clone nothing differs.
"""

import subprocess
import sys
from pathlib import Path

CODE = (
    "schemas",
    "participant",
    "orchestrator",
    "tools",
    "services",
    "scenarios",
    "pyproject.toml",
)
MAIN_BRANCHES = ("origin/HEAD", "origin/main", "main")
CHANGELOG = "CHANGELOG.md"


def git(*arguments: str) -> list[str]:
    """Return the lines that git prints; none when it fails."""
    done = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False)
    return done.stdout.splitlines() if done.returncode == 0 else []


def unreleased(lines: list[str]) -> str:
    """Return the section `## Unreleased` of a changelog."""
    return "\n".join(lines).partition("\n## Unreleased")[2].partition("\n## ")[0]


def main() -> int:
    """Print what is wrong and return the exit code."""
    bases = (git("merge-base", "HEAD", branch) for branch in MAIN_BRANCHES)
    base = next(filter(None, bases), ["HEAD"])[0]
    code = git("diff", "--name-only", base, "--", *CODE)
    code += git("ls-files", "--others", "--exclude-standard", "--", *CODE)
    here = Path(CHANGELOG).read_text(encoding="utf-8").splitlines()
    if not code or unreleased(here) != unreleased(git("show", f"{base}:{CHANGELOG}")):
        return 0
    sys.stderr.write(
        f"{CHANGELOG}: `## Unreleased` is unchanged since {base[:10]}, but {len(code)} code "
        f"files changed ({code[0]} …); add a line on what changed for users\n"
    )
    return 1


if __name__ == "__main__":
    sys.exit(main())
