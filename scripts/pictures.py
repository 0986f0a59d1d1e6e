"""Make every picture and film of the docs, and docs/gallery.md, from real runs: `make pictures`.

    python scripts/pictures.py                  all of them
    python scripts/pictures.py view_ gallery/store   those whose names begin so
    python scripts/pictures.py --check          say which are older than what they show

A picture is older than what it shows when its scenario gives other messages today. What each was
made from is in docs/pictures/made_from.json, with the arithmetic of processors without AVX-512.
Needs `make robots`, Chromium and the extra `dev`; pages are drawn at twice their size. Examples in
other languages are run where their toolchain is installed; the others keep their pictures.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from PIL import Image

from stepbus_orchestrator.recording import Recording
from stepbus_tools.report.charts import Chart, Role, find_signals
from stepbus_tools.report.picture import save

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs/pictures"
PAGE = ROOT / "docs/gallery.md"
MADE_FROM = PICTURES / "made_from.json"
STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SETTLED_MS = 6000
WAITED_MS = 120_000
"""What a page of a scene takes until its meshes are there, drawn by the processor."""
INTRO = """# Gallery

Every scenario and example that ships with stepbus: what it shows, the command that runs it, and a
picture of that run. `make pictures` makes this page and all pictures of it from real runs.

Run times include the start, on a machine with two cores, without the report. The store and Baxter
need `make robots` (414 MB of robot models) first.
"""

_ARITHMETIC = {
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4,AVX512_ICL,AVX512_SPR",
}
Facts = Mapping[str, Any]
"""Of a run: its scenario, hash of its messages, outcome, times [s]."""


class Runs:
    """Runs of scenarios and examples, each once. scripts: those that have drawn from them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.scripts: set[str] = set()

    def of(self, scenario: str) -> Path:
        """Return the folder of a run of a scenario."""
        folder = self._folder / scenario.replace("/", "_")
        if not folder.exists():
            run_command(
                [*STEPBUS, "run", scenario, "--out", str(folder), "--no-report"], may_fail=True
            )
        return folder

    def facts(self, scenario: str) -> Facts:
        """Return the facts of a run of a scenario."""
        result = json.loads((self.of(scenario) / "result.json").read_text())
        # What the participant said, without process ids and paths, which differ in each run.
        reason = re.sub(r"^.*?Error: |; its log: .*$", "", str(result["reason"]))
        return {
            "scenario": scenario,
            "messages": result["messages_sha256"],
            "outcome": result["outcome"],
            "reason": "" if reason == result["outcome"] else reason,
            "simulated_s": round(result["steps"] * result["step_ns"] / 1e9, 1),
            "wall_s": round(result["start_s"] + result["wall_s"], 1),
        }


def run_command(words: Sequence[str], *, cwd: Path = ROOT, may_fail: bool = False) -> None:
    """Run a command, whose errors are those of this script, and whose Python is the one of it."""
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    subprocess.run(
        words,
        cwd=cwd,
        check=not may_fail,
        stdout=subprocess.DEVNULL,
        timeout=900,
        env={**os.environ, **_ARITHMETIC, "PATH": path},
    )


def small(path: Path, colours: int, most: int | None = None) -> None:
    """Make a picture small enough for a repository. most: of its width [pixel]."""
    picture = Image.open(path).convert("RGB")
    picture.thumbnail((most or picture.width, most or picture.height), Image.Resampling.LANCZOS)
    # Median cut forgets the colours of small things, such as a lamp,
    # and maximum coverage those of the page: its eight most frequent are added.
    covering = picture.quantize(colours - 8, Image.Quantize.MAXCOVERAGE).getpalette() or []
    values, counts = np.unique(np.asarray(picture).reshape(-1, 3), axis=0, return_counts=True)
    palette = Image.new("P", (1, 1))
    palette.putpalette([*covering, *values[counts.argsort()[-8:]].ravel().tolist()])
    picture.quantize(palette=palette, dither=Image.Dither.NONE).save(path, optimize=True)


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A scenario or an example in the gallery: a row of docs/gallery.toml."""

    run: str
    section: str
    title: str
    shows: str
    signals: Sequence[str] = ()
    panels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    seen: Sequence[float] = (0.0, 6.0)
    viewpoint: str = "corner"
    needs: str = ""
    before: str = ""
    page: str = ""
    checked: bool = True

    @property
    def scenario(self) -> str:
        """Return what is run."""
        return self.run

    @property
    def name(self) -> str:
        """Return the name of its picture."""
        flat = self.run.removeprefix("examples/").replace("controllers/", "controller_")
        return f"gallery/{flat.replace('/', '_')}.{'png' if self.signals or self.panels else 'gif'}"

    def draw(self, runs: Runs, target: Path) -> None:
        """Make a plot, or a film."""
        if self.before:
            run_command(self.before.split())
        if self.panels:
            save(self.title, [self._panel(runs, title) for title in self.panels], target)
            small(target, 64, 1000)
            return
        folder = runs.of(self.run)
        # The title of a plot is the path of its recording.
        if self.signals:
            words = ["plot", folder.name, *self.signals, "--out", str(target)]
        else:
            start, end = self.seen
            look = f"--size 400x300 --fps 5 --viewpoint {self.viewpoint}"
            span = f"--from {start:g}s --to {end:g}s"
            words = ["export", folder.name, "--video", str(target), *f"{look} {span}".split()]
        run_command([*STEPBUS, *words], cwd=folder.parent)
        if self.signals:
            small(target, 64, 800)

    def _panel(self, runs: Runs, title: str) -> Chart:
        """Return a panel, whose lines may come from several runs."""
        lines = []
        names = list(dict.fromkeys(name for panel in self.panels.values() for name in panel))
        for name, text in self.panels[title].items():
            run, _, signal = text.rpartition(": ")
            with Recording(runs.of(run or self.run) / "run.mcap") as recording:
                (chart,) = find_signals(recording, signal)
            role: Role = "reference" if name == "reference" else "measured"
            number = names.index(name)
            lines.append(replace(chart.lines[0], label=name, number=number, role=role))
        return Chart(title, chart.unit, lines)

    def paragraph(self, facts: Facts) -> str:
        """Return what the page says of it."""
        commands = "\n".join(filter(None, (self.before, f"stepbus run {self.run}")))
        failed = facts["outcome"] != "finished"
        ended = f"; ends with the intended error: {facts['reason']}" if failed else ""
        needs = f" Needs `{self.needs}`." if self.needs else ""
        return (
            f"### {self.title}\n\n{self.shows}{needs} ([Details]({self.page}))\n\n"
            f"```\n{commands}\n```\n\n![{self.title}](pictures/{self.name})\n\n"
            f"{facts['simulated_s']:g} s simulated in {facts['wall_s']:g} s{ended}\n"
        )


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
    needs: ClassVar[str] = "chromium"
    checked: ClassVar[bool] = True

    def draw(self, runs: Runs, target: Path) -> None:
        """Open the page and photograph it."""
        from playwright.sync_api import sync_playwright  # noqa: PLC0415

        width, height = self.size
        with sync_playwright() as playwright, tempfile.TemporaryDirectory() as scratch:
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=FLAGS
            )
            page = browser.new_page(
                viewport={"width": width, "height": height},
                device_scale_factor=2,
                color_scheme="dark" if self.is_dark else "light",
            )
            with self._address(runs, Path(scratch)) as url:
                page.goto(url)
                if self.page != "report":
                    self._settle(page)
                page.wait_for_timeout(500)
                page.screenshot(path=target)
            browser.close()
        small(target, 256)

    def _address(self, runs: Runs, scratch: Path) -> contextlib.AbstractContextManager[str]:
        """Return the address of the page."""
        folder = runs.of(self.scenario)
        if self.page == "view":
            return printed_address([*STEPBUS, "view", str(folder), "--no-open"])
        if self.page == "live":
            look = f"--view --no-open --no-report --real-time --pause-at {self.at:g}"
            words = [*look.split(), "--out", str(scratch / self.scenario)]
            return printed_address([*STEPBUS, "run", self.scenario, *words])
        target = scratch / f"{self.name}.html"
        run_command([*STEPBUS, "report", str(folder), "--out", str(target)])
        return contextlib.nullcontext(target.as_uri())

    def _settle(self, page: Any) -> None:
        """Bring the page of a scene to what its picture shows."""
        page.set_default_timeout(WAITED_MS)
        if self.page == "live":
            page.get_by_text("paused").wait_for()
        if self.tab:
            page.get_by_role("tab", name=self.tab).click()
        if self.page == "view":
            field = page.locator("input[type=text]").first
            field.fill(f"{self.at:g}")
            field.press("Enter")
        page.wait_for_timeout(SETTLED_MS)
        # Chromium draws here without a graphics card, and viser says so.
        for button in page.locator(".mantine-Notification-closeButton").all():
            button.click()
        page.mouse.move(5, self.size[1] - 5)


@contextlib.contextmanager
def printed_address(words: Sequence[str]) -> Iterator[str]:
    """Yield the address that a command prints, and end it afterwards."""
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stdout is not None
        said = []
        for line in process.stdout:
            said.append(line)
            if found := re.search(r"https?://\S+", line):
                yield found[0]
                break
        else:
            raise SystemExit(f"{' '.join(words)} printed no URL:\n{''.join(said)}")
        process.terminate()


@dataclass(frozen=True)
class Drawn:
    """A picture that a script of the store draws, all of them at once."""

    name: str
    script: str
    scenario: ClassVar[str] = "store"
    needs: ClassVar[str] = ""
    checked: ClassVar[bool] = True

    def draw(self, runs: Runs, target: Path) -> None:
        """Run the script."""
        if self.script not in runs.scripts:
            script = str(ROOT / "store/scripts" / self.script)
            run_command([sys.executable, script, str(runs.of("store") / "run.mcap")])
            runs.scripts.add(self.script)
        if target.suffix == ".png":
            small(target, 256)


ENTRIES = tuple(
    Entry(**row) for row in tomllib.loads((ROOT / "docs/gallery.toml").read_text())["entry"]
)
SHOTS = (
    Shot("report_two_link.png", "two_link", "report"),
    Shot("report_baxter.png", "baxter", "report", is_dark=True),
    Shot("report_store.png", "store", "report"),
    Shot("view_two_link.png", "two_link", "view", at=4.0, tab="Curves"),
    Shot("view_store.png", "store", "view", at=6.0, tab="Curves"),
    Shot("view_baxter.png", "baxter", "view", size=(390, 844), at=4.0, tab="Curves"),
    Shot("view_live.png", "two_link", "live", at=700, tab="Curves"),
    Shot("view_live_baxter.png", "baxter", "live", is_dark=True, at=120),
    Shot("view_live_store.png", "store", "live", at=500, tab="Images"),
)
DRAWN = (
    *(
        Drawn(f"store_{name}.png", "store_pictures.py")
        for name in ("above", "camera", "grasp", "sale", "scene")
    ),
    Drawn("store.gif", "store_movie.py"),
)
ALL: tuple[Shot | Drawn | Entry, ...] = (*SHOTS, *DRAWN, *ENTRIES)


def made_from() -> dict[str, Facts]:
    """Return the facts of the runs that the pictures were made from."""
    return dict(json.loads(MADE_FROM.read_text()))


def gallery(facts: Mapping[str, Facts]) -> str:
    """Return the page of the gallery. facts: by picture."""
    parts = [INTRO]
    for section, entries in groupby(ENTRIES, lambda entry: entry.section):
        parts.append(f"## {section}\n")
        parts += [entry.paragraph(facts[entry.name]) for entry in entries if entry.name in facts]
    return "\n".join(parts)


def make(names: tuple[str, ...], runs: Runs) -> None:
    """Make pictures, then the page. names: beginnings; empty: all."""
    facts = made_from()
    for picture in ALL:
        if names and not picture.name.startswith(names):
            continue
        if picture.needs and not shutil.which(picture.needs):
            say(f"{picture.name}: no {picture.needs} here; it stays as it is")
            continue
        target = PICTURES / picture.name
        picture.draw(runs, target)
        facts[picture.name] = runs.facts(picture.scenario)
        say(f"{target.relative_to(ROOT)}  {target.stat().st_size // 1024} kB")
        text = json.dumps(facts, indent=2, sort_keys=True, ensure_ascii=False)
        MADE_FROM.write_text(text + "\n")
    PAGE.write_text(gallery(facts))


def problems(runs: Runs) -> Iterator[str]:
    """Yield a line for each old picture."""
    facts = made_from()
    for picture in ALL:
        if picture.name not in facts:
            yield f"{picture.name} was not made by this script"
        elif picture.checked and (not picture.needs or isinstance(picture, Shot)):
            if isinstance(picture, Entry) and picture.before:
                run_command(picture.before.split())
            if runs.facts(picture.scenario)["messages"] != facts[picture.name]["messages"]:
                yield f"{picture.name} is older than what it shows"


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


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
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(Path(folder))
        if not args.check:
            make(tuple(args.names), runs)
            return 0
        found = list(problems(runs))
        for line in found:
            say(f"{line}; make pictures")
        return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
