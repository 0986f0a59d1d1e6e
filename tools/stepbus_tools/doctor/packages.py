"""Packages: installed, recent enough, loadable."""

import contextlib
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version

import msgspec

from stepbus_participant import install_command
from stepbus_tools.doctor.machine import Finding

EXTRAS = {
    "sim": "physics and dynamics: the plant and the controller that ship",
    "report": "the plots of a run, report.png",
    "export": "tables, video, and files for ROS 2 and Foxglove",
    "view": "3D: `stepbus view`, `run --view`, `export --scene`",
    "sweep": "many runs of one scenario: tables, a page, an optimizer, a cluster",
    "gym": "environments of Gymnasium",
    "docs": "the documentation site",
    "dev": "the tests, the type checker and the linter",
}
"""Extra of stepbus → what it is for."""

_NATIVE = {"pin": "pinocchio", "pybullet": "pybullet"}
"""Package → its module, of those that only participants load."""

_OLDEST_PYTHON = (3, 11)
_LOAD_DEADLINE_S = 30.0
_KILL_S = 5.0
_REQUIREMENT = re.compile(r"([\w.-]+)(?:\s*>=\s*([\d.]+))?")


class Requirement(msgspec.Struct, frozen=True):
    """A package and the oldest version that works; empty: any."""

    name: str
    oldest: str = ""

    def __str__(self) -> str:
        return f"{self.name}>={self.oldest}" if self.oldest else self.name


def needed(extra: str = "") -> list[Requirement]:
    """Return what stepbus, or one of its extras, needs.

    Raises PackageNotFoundError when stepbus itself is not installed.
    """
    rows = [row.partition(";") for row in requires("stepbus") or []]
    of_extra = {row: marker.replace("'", '"').strip() for row, _, marker in rows}
    wanted = f'extra == "{extra}"' if extra else ""
    packages = [parse(row) for row, marker in of_extra.items() if marker == wanted]
    # An extra may include another one: `stepbus[sim]`.
    return [requirement for requirement in packages if requirement.name != "stepbus"]


def parse(row: str) -> Requirement:
    """Return the requirement that a row such as `numpy>=2.2` stands for."""
    match = _REQUIREMENT.match(row)
    return Requirement(match[1], match[2] or "") if match else Requirement(row)


def versions() -> Iterator[Finding]:
    """Check Python, stepbus and its dependencies."""
    python = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info < _OLDEST_PYTHON:
        yield Finding(what="python", verdict="fail", text=f"{python}; stepbus needs 3.11 or newer")
    else:
        yield Finding(what="python", verdict="ok", text=python)
    try:
        requirements = [Requirement("stepbus"), *needed()]
    except PackageNotFoundError:
        text = "is not installed, only found; run `pip install -e .` in its clone"
        yield Finding(what="stepbus", verdict="fail", text=text)
        return
    for requirement in requirements:
        yield _package(requirement)


def _package(requirement: Requirement) -> Finding:
    try:
        have = version(requirement.name)
    except PackageNotFoundError:
        text = f"is not installed; run `pip install '{requirement}'`"
        return Finding(what=requirement.name, verdict="fail", text=text)
    if _numbers(have) < _numbers(requirement.oldest):
        text = f"{have} is too old; run `pip install '{requirement}'`"
        return Finding(what=requirement.name, verdict="fail", text=text)
    return Finding(what=requirement.name, verdict="ok", text=have)


def _numbers(text: str) -> list[int]:
    """Return the leading numbers of a version: `3.2.7rc1` is 3, 2, 7."""
    return [int(part) for part in re.findall(r"(?:^|\.)(\d+)", text)]


def loads() -> Iterator[Finding]:
    """Load compiled packages, where they are installed, in processes of their own.

    A broken one may end its process.
    """
    children = {
        name: subprocess.Popen(
            [sys.executable, "-c", f"import {module}"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for name, module in _NATIVE.items()
        if _package(Requirement(name)).verdict == "ok"
    }
    for name, child in children.items():
        yield _load(name, child)


def _load(name: str, child: subprocess.Popen[str]) -> Finding:
    what = f"load {name}"
    try:
        _, output = child.communicate(timeout=_LOAD_DEADLINE_S)
    except subprocess.TimeoutExpired:
        child.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            # What it has started may still hold the pipe.
            child.communicate(timeout=_KILL_S)
        text = f"takes over {_LOAD_DEADLINE_S:g} s; is the disk or the machine overloaded?"
        return Finding(what=what, verdict="fail", text=text)
    if child.returncode:
        last = (output.strip().splitlines() or [f"exit code {child.returncode}"])[-1]
        text = f"{last}; run `pip install --force-reinstall {name}`"
        return Finding(what=what, verdict="fail", text=text)
    return Finding(what=what, verdict="ok", text="works")


def extras() -> Iterator[Finding]:
    """Report each extra: what it is for, what is missing, how to install it."""
    try:
        required = {extra: needed(extra) for extra in EXTRAS}
    except PackageNotFoundError:
        return
    for extra, requirements in required.items():
        lacking = [r.name for r in requirements if _package(r).verdict != "ok"]
        text = EXTRAS[extra]
        if lacking:
            text = f"{text}; missing {', '.join(lacking)}: `{install_command(extra)}`"
        yield Finding(what=f"extra {extra}", verdict="warn" if lacking else "ok", text=text)
