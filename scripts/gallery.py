"""Make the page docs/gallery.md and its pictures from real runs: `make gallery`.

    python scripts/gallery.py            run everything, make every picture and the page
    python scripts/gallery.py store/     those whose names begin so
    python scripts/gallery.py --check    say which are older than what they show

Needs `make robots` and the extra `dev`. Examples in other languages are made where their toolchain
is installed; the others keep their pictures.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "gallery.md"
PICTURES = ROOT / "docs" / "pictures" / "gallery"
LIST = ROOT / "docs" / "gallery.toml"
FACTS = PICTURES / "facts.json"
STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]
INTRO = """# Gallery

Every scenario and example that ships with stepbus: what it shows, the command that runs it, and a
picture of that run. `make gallery` makes this page and all pictures of it from real runs.

Run times include the start, on a machine with two cores, without the report. The store and Baxter
need `make robots` (414 MB of robot models) first.
"""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A scenario or an example, and what its picture shows: a row of docs/gallery.toml."""

    run: str
    section: str
    title: str
    shows: str
    signals: Sequence[str] = ()
    seen: Sequence[float] = (0.0, 6.0)
    viewpoint: str = "corner"
    needs: str = ""
    before: str = ""
    page: str = ""
    checked: bool = True

    @property
    def picture(self) -> Path:
        """The file of its picture."""
        flat = self.run.removeprefix("examples/").replace("controllers/", "controller_")
        return PICTURES / f"{flat.replace('/', '_')}.{'png' if self.signals else 'gif'}"


def listed() -> tuple[Entry, ...]:
    """Return the entries of docs/gallery.toml, in order."""
    rows = tomllib.loads(LIST.read_text())["entry"]
    return tuple(Entry(**row) for row in rows)


ENTRIES = listed()


def run(entry: Entry, folder: Path) -> dict[str, Any]:
    """Run an entry; return the facts of its run: hash of its messages, outcome, times [s]."""
    if entry.before:
        subprocess.run(entry.before.split(), cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    words = [*STEPBUS, "run", entry.run, "--out", str(folder), "--no-report"]
    subprocess.run(words, cwd=ROOT, check=False, capture_output=True, timeout=900)
    result = json.loads((folder / "result.json").read_text())
    # What the participant said, without process ids and paths, which differ in each run.
    reason = re.sub(r"^.*?Error: |; its log: .*$", "", str(result["reason"]))
    return {
        "messages": result["messages_sha256"],
        "outcome": result["outcome"],
        "reason": "" if reason == result["outcome"] else reason,
        "simulated_s": round(result["steps"] * result["step_ns"] / 1e9, 1),
        "wall_s": round(result["start_s"] + result["wall_s"], 1),
    }


def draw(entry: Entry, folder: Path) -> None:
    """Make the picture of a run: a plot, or a film."""
    PICTURES.mkdir(exist_ok=True)
    target = entry.picture
    if entry.signals:
        words = [*STEPBUS, "plot", folder.name, *entry.signals, "--out", str(target)]
    else:
        start, end = entry.seen
        words = [*STEPBUS, "export", str(folder), "--video", str(target), "--size", "400x300"]
        words += ["--viewpoint", entry.viewpoint, "--fps", "5"]
        words += ["--from", f"{start:g}s", "--to", f"{end:g}s"]
    # The title of a plot is the path of its recording.
    subprocess.run(words, cwd=folder.parent, check=True, capture_output=True)
    if entry.signals:
        small(target)


def small(path: Path) -> None:
    """Make a plot small enough for a repository: 800 pixels wide, 64 colours."""
    from PIL import Image  # noqa: PLC0415

    picture = Image.open(path).convert("RGB")
    picture.thumbnail((800, 800), Image.Resampling.LANCZOS)
    picture.quantize(64).save(path, optimize=True)


def page(facts: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the page. facts: name of an entry → facts of its run."""
    parts = [INTRO]
    for section, entries in groupby(ENTRIES, lambda entry: entry.section):
        parts.append(f"## {section}\n")
        parts += [paragraph(entry, facts[entry.run]) for entry in entries if entry.run in facts]
    return "\n".join(parts)


def paragraph(entry: Entry, facts: Mapping[str, Any]) -> str:
    """Return what the page says of one entry."""
    commands = [*([entry.before] if entry.before else []), f"stepbus run {entry.run}"]
    took = f"{facts['simulated_s']:g} s simulated in {facts['wall_s']:g} s"
    ended = (
        ""
        if facts["outcome"] == "finished"
        else f"; ends with the intended error: {facts['reason']}"
    )
    needs = f" Needs `{entry.needs}`." if entry.needs else ""
    return (
        f"### {entry.title}\n\n"
        f"{entry.shows}{needs} ([Details]({entry.page}))\n\n"
        "```\n" + "\n".join(commands) + "\n```\n\n"
        f"![{entry.title}](pictures/gallery/{entry.picture.name})\n\n"
        f"{took}{ended}\n"
    )


def known_facts() -> dict[str, dict[str, Any]]:
    """Return the facts of the runs that the pictures were made from."""
    return dict(json.loads(FACTS.read_text())) if FACTS.exists() else {}


def problems_of(folder: Path) -> list[str]:
    """Return a line for each old picture. folder: a new one, for runs."""
    facts = known_facts()
    problems = [f"{entry.run} has no picture" for entry in ENTRIES if entry.run not in facts]
    for number, entry in enumerate(ENTRIES):
        old = facts.get(entry.run)
        if old is None or entry.needs or not entry.checked:
            continue
        if run(entry, folder / str(number))["messages"] != old["messages"]:
            problems.append(f"the picture of {entry.run} is older than what it shows")
    return problems


def make(entries: Iterable[Entry], folder: Path) -> None:
    """Run the entries and make their pictures, then the page. folder: a new one, for runs."""
    facts = known_facts()
    for entry in entries:
        if entry.needs and not shutil.which(entry.needs):
            say(f"{entry.run}: no {entry.needs} here; its picture stays as it is")
            continue
        facts[entry.run] = run(entry, out := folder / entry.run.replace("/", "_"))
        draw(entry, out)
        say(f"{entry.picture.relative_to(ROOT)}  {entry.picture.stat().st_size // 1024} kB")
        FACTS.write_text(json.dumps(facts, indent=2, sort_keys=True, ensure_ascii=False) + "\n")
    PAGE.write_text(page(facts))


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(words: Sequence[str] | None = None) -> int:
    """Make the gallery, or check it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="beginnings of the names to make; default: all")
    parser.add_argument(
        "--check", action="store_true", help="make nothing; exit code 1 for an old one"
    )
    args = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as folder:
        if args.check:
            problems = problems_of(Path(folder))
            for line in problems:
                say(f"{line}; make gallery")
            return 1 if problems else 0
        names = tuple(args.names)
        make((one for one in ENTRIES if not names or one.run.startswith(names)), Path(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
