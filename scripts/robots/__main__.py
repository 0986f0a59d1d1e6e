"""Robots of other packages in stepbus: the tables of docs/guide/running/robots.md.

    python -m scripts.robots [--packages] [ROBOT ...]

Without names, it measures all robots and writes the page; `make robots-page` installs their
packages first, which --packages prints. Exit code 1: a difference is above its tolerance.
"""

import argparse
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scripts.pages import filled
from scripts.robots.case import Case, G
from scripts.robots.libraries import Library, read

from stepbus_participant import package_path
from stepbus_schemas.tables import table

ENGINES = {"pybullet": "PyBullet", "mujoco": "MuJoCo"}
_FOLDER = Path(__file__).parent
_PAGE = _FOLDER.parents[1] / "docs/guide/running/robots.md"
_INFINITE = 1e8
_QUANTITIES = ("limits", "mimic", "model poses", "model torque", "poses", "torque", "mass")


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A row of robots.toml. package: `name==version`. on_floor: it runs on a floor, not fixed.

    note: why it differs where it does.
    """

    name: str
    kind: str
    package: str
    file: str
    on_floor: bool = False
    note: str = ""

    @property
    def url(self) -> str:
        """Return the address of its file."""
        return f"package://{self.file}"


@dataclass
class Measured:
    """What was measured of a robot.

    library: None: it does not read the file. refused: engine → why. differences, runs: of the
    other engines.
    """

    robot: Robot
    library: Library | None = None
    refused: dict[str, str] = field(default_factory=dict)
    differences: dict[str, dict[str, float]] = field(default_factory=dict)
    runs: dict[str, dict[str, Any]] = field(default_factory=dict)

    def tolerance(self, engine: str, quantity: str) -> float:
        """Return how far a quantity may be from the library's, in SI units."""
        light = self.library.light if self.library else 0.0
        if quantity == "poses" and engine == "pybullet":
            return 1e-6
        if "torque" in quantity:
            # Of a lever of 2 m.
            return 1e-9 * max(1.0, self.differences[engine]["largest torque"]) + light * G * 2.0
        return 1e-9 + (light if quantity == "mass" else 0.0)

    def excesses(self) -> list[str]:
        """Return the differences that are above their tolerances, as text."""
        return [
            f"{self.robot.name}, {ENGINES[engine]}: {quantity} {row[quantity]:.1e}"
            for engine, row in self.differences.items()
            for quantity in _QUANTITIES
            if row[quantity] > self.tolerance(engine, quantity)
        ]

    def apart(self) -> float:
        """Return how far the joints of the two engines are apart [rad or m]."""
        one, other = (self.runs[engine]["joints"] for engine in ENGINES)
        return max(float(np.abs(one[name] - other[name]).max()) for name in one)


def robots() -> list[Robot]:
    """Return all robots."""
    rows = tomllib.loads((_FOLDER / "robots.toml").read_text(encoding="utf-8"))["robot"]
    return [Robot(**row) for row in rows]


def measure(robot: Robot, engines: Iterable[str] = ENGINES) -> Measured:
    """Load, compare and run a robot."""
    measured = Measured(robot)
    try:
        measured.library = read(package_path(robot.url))
    except ValueError as exc:
        measured.refused = dict.fromkeys(engines, f"Pinocchio does not read it: {exc}")
        return measured
    for engine in engines:
        with tempfile.TemporaryDirectory() as folder:
            case = Case(robot.url, engine, measured.library, Path(folder))
            if refusal := case.refusal():
                measured.refused[engine] = _sentence(refusal)
                continue
            measured.differences[engine] = case.compare()
            measured.runs[engine] = case.run(on_floor=robot.on_floor)
    return measured


def _sentence(error: str) -> str:
    """Return the first problem of an error message, without its files."""
    problem = error.splitlines()[0].removeprefix("stepbus: ")
    for place in ("participants.plant.params.world: ", "participants.plant: ", "urdf: "):
        problem = problem.rpartition(place)[2]
    return re.sub(r"(?<![\w/])/(?:[\w.+-]+/)+", "", problem).strip().replace("<", "\\<")


# --- the page ------------------------------------------------------------------------------------


def _number(value: float) -> str:
    if not value <= _INFINITE:
        return "∞" if value > _INFINITE else "–"
    return f"{value:.0e}" if value else "0"


def _overview(measured: Sequence[Measured]) -> str:
    rows = []
    for row in measured:
        robot, library = row.robot, row.library
        form = {".xml": "MJCF", ".xacro": "xacro"}.get(Path(robot.file).suffix, "URDF")
        count = f"{len(library.joints)}" if library else ""
        if library and library.mimics:
            count += f", {len(library.mimics)} of them mimic"
        engines = ["refused" if engine in row.refused else "runs" for engine in ENGINES]
        rows.append([robot.name, robot.kind, f"`{robot.package}`", form, count, *engines])
    header = ["Robot", "Kind", "Package", "Format", "Joints", *ENGINES.values()]
    return table(header, rows)


def _differences(measured: Sequence[Measured]) -> str:
    rows = []
    for row in measured:
        for engine, values in row.differences.items():
            cells = []
            for quantity in _QUANTITIES:
                text = _number(values[quantity])
                is_excess = values[quantity] > row.tolerance(engine, quantity)
                cells.append(f"**{text}**" if is_excess else text)
            rows.append([row.robot.name, ENGINES[engine], *cells])
    header = ["limits", "mimic", "poses, model", "torques, model", "poses", "torques", "mass"]
    return table(["Robot", "Engine", *header], rows)


def _runs(measured: Sequence[Measured]) -> str:
    rows = []
    for row in measured:
        if not row.runs:
            continue
        what = "on a floor: weight [-]" if row.robot.on_floor else "sine: tracking error"
        key, form = ("weight", ".4f") if row.robot.on_floor else ("tracking", ".1e")
        values = [f"{row.runs[n][key]:{form}}" if n in row.runs else "" for n in ENGINES]
        slips = [_number(row.runs[n]["slip"]) if n in row.runs else "" for n in ENGINES]
        mimics = row.library is not None and row.library.mimics
        apart = _number(row.apart()) if len(row.runs) == len(ENGINES) else ""
        rows.append([row.robot.name, what, *values, apart, *(slips if mimics else ["", ""])])
    followers = [f"followers, {name}" for name in ENGINES.values()]
    return table(["Robot", "Run", *ENGINES.values(), "apart", *followers], rows)


def _refused(measured: Sequence[Measured]) -> str:
    rows = []
    for row in measured:
        by_reason: dict[str, list[str]] = {}
        for engine, reason in row.refused.items():
            by_reason.setdefault(reason, []).append(ENGINES[engine])
        rows += [[row.robot.name, ", ".join(names), why] for why, names in by_reason.items()]
    return table(["Robot", "Engine", "Reason"], rows)


def write_page(measured: Sequence[Measured]) -> None:
    """Put the tables into the page, between its marks."""
    notes = "".join(f"- {row.robot.name}: {row.robot.note}\n" for row in measured if row.robot.note)
    parts = {
        "Robots": _overview(measured),
        "Differences": f"{_differences(measured)}\n{notes}",
        "Runs": _runs(measured),
        "Refused": _refused(measured),
    }
    text = "\n".join(f"## {title}\n\n{part}" for title, part in parts.items())
    page = filled(_PAGE.read_text(encoding="utf-8"), {"tables": text})
    _PAGE.write_text(page, encoding="utf-8")


def main() -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--packages", action="store_true", help="print what to install")
    parser.add_argument("robot", nargs="*", help="some of the robots, by name")
    given = parser.parse_args()
    if given.packages:
        sys.stdout.write("\n".join(sorted({robot.package for robot in robots()})) + "\n")
        return 0
    measured = []
    for robot in robots():
        if not given.robot or robot.name in given.robot:
            sys.stderr.write(f"{robot.name}\n")
            measured.append(measure(robot))
    if given.robot:
        tables = (_differences(measured), _runs(measured), _refused(measured))
        sys.stdout.write("\n".join(tables))
    else:
        write_page(measured)
    excesses = [text for row in measured if not row.robot.note for text in row.excesses()]
    sys.stderr.write("".join(f"{text}\n" for text in excesses))
    return 1 if excesses else 0


if __name__ == "__main__":
    sys.exit(main())
