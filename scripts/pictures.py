"""Make every picture and film of the docs from real runs: `make pictures`.

    python scripts/pictures.py                  all of them
    python scripts/pictures.py report_baxter    those whose names begin so
    python scripts/pictures.py --check          say which are older than what they show

A picture is older than what it shows when its scenario gives other messages today. The hash of the
messages that each was made from is in docs/pictures/made_from.json. Needs `make robots`, Chromium
and the extra `dev`; pages are drawn at twice their size.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
MADE_FROM = PICTURES / "made_from.json"
STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SETTLED_MS = 6000
WAITED_MS = 120_000
"""What a page of a scene takes until its meshes are there, drawn by the processor."""
_ADDRESS = re.compile(r"https?://\S+")


@dataclass(frozen=True)
class Shot:
    """A picture of a page.

    size: of the window [pixel]. at: where a live run pauses [step], or what a recording shows [s].
    tab: which one is open.
    """

    name: str
    scenario: str
    page: str
    size: tuple[int, int] = (1280, 800)
    is_dark: bool = False
    at: float = 0.0
    tab: str = ""


SHOTS = (
    Shot("report_two_link", "two_link", "report"),
    Shot("report_baxter", "baxter", "report", is_dark=True),
    Shot("report_store", "store", "report"),
    Shot("view_two_link", "two_link", "view", at=4.0, tab="Curves"),
    Shot("view_store", "store", "view", at=6.0, tab="Curves"),
    Shot("view_baxter", "baxter", "view", size=(390, 844), at=4.0, tab="Curves"),
    Shot("view_live", "two_link", "live", at=700, tab="Curves"),
    Shot("view_live_baxter", "baxter", "live", is_dark=True, at=120),
    Shot("view_live_store", "store", "live", at=500, tab="Images"),
)
STORE = ("store.gif", "store_above", "store_camera", "store_grasp", "store_sale", "store_scene")
"""What the scripts of the store draw."""


class Runs:
    """Runs of scenarios, each once. hashes: scenario → hash of its messages."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.hashes: dict[str, str] = {}

    def of(self, scenario: str) -> Path:
        """Return the folder of a run of a scenario."""
        folder = self._folder / scenario
        if not folder.exists():
            run_command([*STEPBUS, "run", scenario, "--out", str(folder), "--no-report"])
            result = json.loads((folder / "result.json").read_text())
            self.hashes[scenario] = result["messages_sha256"]
        return folder


def run_command(words: Sequence[str]) -> None:
    """Run a command, whose errors are those of this script."""
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)


@contextlib.contextmanager
def address(words: Sequence[str]) -> Iterator[str]:
    """Yield the address that a command prints, and end it afterwards."""
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stdout is not None
        said = []
        for line in process.stdout:
            said.append(line)
            if found := _ADDRESS.search(line):
                yield found[0]
                break
        else:
            raise SystemExit(f"{' '.join(words)} printed no URL:\n{''.join(said)}")
        process.terminate()


def opened(shot: Shot, runs: Runs, scratch: Path) -> contextlib.AbstractContextManager[str]:
    """Return the address of the page that a shot is of."""
    folder = runs.of(shot.scenario)
    if shot.page == "view":
        return address([*STEPBUS, "view", str(folder), "--no-open"])
    if shot.page == "live":
        out = [
            "--out",
            str(scratch / shot.name / shot.scenario),
            "--no-report",
            "--real-time",
            "--pause-at",
            str(round(shot.at)),
        ]
        return address([*STEPBUS, "run", shot.scenario, "--view", "--no-open", *out])
    target = scratch / f"{shot.name}.html"
    run_command([*STEPBUS, "report", str(folder), "--out", str(target)])
    return contextlib.nullcontext(target.as_uri())


def photograph(browser: Any, shot: Shot, runs: Runs, scratch: Path) -> Path:
    """Make the picture of a page; return its path."""
    width, height = shot.size
    context = browser.new_context(
        viewport={"width": width, "height": height},
        device_scale_factor=2,
        color_scheme="dark" if shot.is_dark else "light",
    )
    target = PICTURES / f"{shot.name}.png"
    with opened(shot, runs, scratch) as url:
        page = context.new_page()
        page.goto(url)
        if shot.page != "report":
            settle(page, shot)
        page.wait_for_timeout(500)
        page.screenshot(path=target)
    context.close()
    return small(target)


def settle(page: Any, shot: Shot) -> None:
    """Bring the page of a scene to what its picture shows."""
    page.set_default_timeout(WAITED_MS)
    if shot.page == "live":
        page.get_by_text("paused").wait_for()
    if shot.tab:
        page.get_by_role("tab", name=shot.tab).click()
    if shot.page == "view":
        field = page.locator("input[type=text]").first
        field.fill(f"{shot.at:g}")
        field.press("Enter")
    page.wait_for_timeout(SETTLED_MS)
    # Chromium draws here without a graphics card, and viser says so.
    for button in page.locator(".mantine-Notification-closeButton").all():
        button.click()
    page.mouse.move(5, shot.size[1] - 5)


def small(path: Path) -> Path:
    """Make a picture small enough for a repository: 256 colours."""
    from PIL import Image  # noqa: PLC0415

    # Median cut forgets the colours of small things, such as a lamp,
    # and maximum coverage those of the page: its eight most frequent are added.
    picture = Image.open(path).convert("RGB")
    covering = picture.quantize(248, Image.Quantize.MAXCOVERAGE).getpalette() or []
    colours, counts = np.unique(np.asarray(picture).reshape(-1, 3), axis=0, return_counts=True)
    palette = Image.new("P", (1, 1))
    palette.putpalette([*covering, *colours[counts.argsort()[-8:]].ravel().tolist()])
    picture.quantize(palette=palette, dither=Image.Dither.NONE).save(path, optimize=True)
    return path


def store(runs: Runs) -> Iterator[Path]:
    """Yield what the scripts of the store have drawn."""
    recording = str(runs.of("store") / "run.mcap")
    for script in ("store_pictures.py", "store_movie.py"):
        run_command([sys.executable, str(ROOT / "store" / "scripts" / script), recording])
    for name in STORE:
        yield PICTURES / name if "." in name else small(PICTURES / f"{name}.png")


def make(names: Sequence[str], runs: Runs, scratch: Path) -> Iterator[tuple[str, str]]:
    """Yield name and scenario of each picture that was made. names: beginnings; empty: all."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415

    def is_wanted(name: str) -> bool:
        return not names or any(name.startswith(one) for one in names)

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        raise SystemExit("Chromium is not installed; it renders the pages")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        for shot in SHOTS:
            if is_wanted(shot.name):
                say(photograph(browser, shot, runs, scratch))
                yield shot.name, shot.scenario
        browser.close()
    if any(map(is_wanted, STORE)):
        for path in store(runs):
            say(path)
            yield path.stem, "store"


def say(path: Path) -> None:
    """Print which picture was made."""
    sys.stdout.write(f"{path.relative_to(ROOT)}  {path.stat().st_size // 1024} kB\n")
    sys.stdout.flush()


def check(runs: Runs, made_from: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Return a sentence for each picture that is older than what it shows."""
    shown = {*(shot.name for shot in SHOTS), *(name.removesuffix(".gif") for name in STORE)}
    problems = [f"{name} was not made by this script" for name in sorted(shown - made_from.keys())]
    for name, row in made_from.items():
        runs.of(row["scenario"])
        if runs.hashes[row["scenario"]] != row["messages"]:
            problems.append(f"{name} is out of date: scenario {row['scenario']} has changed")
    return problems


def main() -> int:
    """Make pictures, or check them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="prefixes of the pictures to make; default: all")
    parser.add_argument(
        "--check", action="store_true", help="make nothing; exit with 1 if a picture is out of date"
    )
    args = parser.parse_args()
    made_from = json.loads(MADE_FROM.read_text()) if MADE_FROM.exists() else {}
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(Path(folder))
        if args.check:
            problems = check(runs, made_from)
            sys.stdout.write("".join(f"{line}; make pictures\n" for line in problems))
            return 1 if problems else 0
        for name, scenario in make(args.names, runs, Path(folder)):
            made_from[name] = {"scenario": scenario, "messages": runs.hashes[scenario]}
            MADE_FROM.write_text(json.dumps(made_from, indent=2, sort_keys=True) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
