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


def git(*arguments: str) -> str | None:
    """Return what git prints, or None when it fails."""
    done = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False)
    return done.stdout if done.returncode == 0 else None


def base_commit() -> str | None:
    """Return the commit to compare with, or None where there is no history."""
    for branch in MAIN_BRANCHES:
        base = git("merge-base", "HEAD", branch)
        if base is not None:
            return base.strip()
    head = git("rev-parse", "--verify", "HEAD")
    return None if head is None else head.strip()


def changed_code(base: str) -> list[str]:
    """Return the code files that differ from those of a commit, new ones included."""
    changed = git("diff", "--name-only", base, "--", *CODE) or ""
    new = git("ls-files", "--others", "--exclude-standard", "--", *CODE) or ""
    return (changed + new).splitlines()


def unreleased(changelog: str) -> str:
    """Return the section `## Unreleased` of a changelog."""
    _, _, rest = changelog.partition("## Unreleased\n")
    return rest.partition("\n## ")[0].strip()


def missing_entry() -> str | None:
    """Return what is wrong, one sentence, or None."""
    base = base_commit()
    changed = [] if base is None else changed_code(base)
    if base is None or not changed:
        return None
    before = unreleased(git("show", f"{base}:{CHANGELOG}") or "")
    if unreleased(Path(CHANGELOG).read_text(encoding="utf-8")) != before:
        return None
    return (
        f"{CHANGELOG}: `## Unreleased` is unchanged since {base[:10]}, but {len(changed)} code "
        f"files changed ({changed[0]} …); add a line on what changed for users"
    )


def main() -> int:
    """Print what is wrong and return the exit code."""
    problem = missing_entry()
    if problem is not None:
        sys.stderr.write(f"{problem}\n")
    return 0 if problem is None else 1


if __name__ == "__main__":
    sys.exit(main())
