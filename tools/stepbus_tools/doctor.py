"""Checks this machine for what stepbus needs: packages, the bus, extras."""

import contextlib
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Literal

import msgspec

from stepbus_orchestrator.errors import BusFailed
from stepbus_orchestrator.processes.endpoints import make_mesh
from stepbus_orchestrator.scenario.model import BusSpec, Scenario
from stepbus_participant import BusError, Endpoint, ZenohBus, import_error_hint, install_command

Verdict = Literal["ok", "warn", "fail"]

EXTRAS = {
    "run": "core: runs, recordings, command line",
    "sim": "physics and dynamics: the built-in plant and controller",
    "mujoco": "physics with MuJoCo, for every current Python",
    "report": "the plots of a run, report.png",
    "export": "tables, video, and files for ROS 2 and Foxglove",
    "rerun": "files for Rerun: `export --rerun` (170 MB)",
    "view": "3D: `stepbus view`, `run --view`, `export --scene`",
    "sweep": "sweeps: tables, report page, optimizer",
    "cluster": "sweeps on a Ray cluster",
    "coppelia": "scripts for CoppeliaSim: `stepbus coppelia`",
    "fmi": "FMUs: `stepbus run model.fmu`, `stepbus export-fmu`",
    "gym": "Gymnasium environments",
    "docs": "the documentation site",
    "dev": "the tests, the type checker and the linter",
}
"""Extra of stepbus → what it is for."""

_NATIVE = {"pin": "pinocchio", "pybullet": "pybullet", "mujoco": "mujoco"}
"""Package → its module, of those that only participants load."""

_REQUIREMENT = re.compile(r"[\w.-]+")
_PYTHON = re.compile(r'python_version (<|>=) "(\d+)\.(\d+)"')
_LOAD_DEADLINE_S = 30.0
_BUS_DEADLINE_S = 15.0
_AGAIN_S = 0.01


class Finding(msgspec.Struct, frozen=True):
    """The result of one check.

    warn: runs are slower, or what is missing not every user needs. fail: runs do not work.
    """

    what: str
    verdict: Verdict
    text: str


def examine() -> list[Finding]:
    """Return all findings, the ones that others depend on first."""
    return [*versions(), *loads(), link("unix"), link("tcp"), *extras()]


# --- packages ----------------------------------------------------------------------------------


def needed(extra: str = "") -> list[str]:
    """Return the packages that stepbus, or one of its extras, needs on this Python.

    Raises PackageNotFoundError when stepbus itself is not installed.
    """
    rows = (row.partition(";") for row in requires("stepbus") or [])
    matches = [_REQUIREMENT.match(row) for row, _, marker in rows if _applies(marker, extra)]
    # An extra may include another one: `stepbus[sim]`.
    return [match[0] for match in matches if match and match[0] != "stepbus"]


def _applies(marker: str, extra: str) -> bool:
    """Return whether a requirement is one of an extra, on this Python; no extra: of all."""
    parts = [part.strip(" ()") for part in marker.replace("'", '"').split(" and ")]
    if [f'extra == "{extra}"'] * bool(extra) != [p for p in parts if p.startswith("extra")]:
        return False
    for found in filter(None, map(_PYTHON.match, parts)):
        version = int(found[2]), int(found[3])
        if (sys.version_info[:2] < version) != (found[1] == "<"):
            return False
    return True


def versions() -> Iterator[Finding]:
    """Check Python, stepbus and its dependencies."""
    yield Finding("python", "ok", ".".join(map(str, sys.version_info[:3])))
    try:
        yield Finding("stepbus", "ok", version("stepbus"))
        yield from map(_package, (*needed(), *needed("run")))
    except PackageNotFoundError:
        text = "is importable, but not installed; run `pip install -e .` in its clone"
        yield Finding("stepbus", "fail", text)


def _package(name: str) -> Finding:
    try:
        return Finding(name, "ok", version(name))
    except PackageNotFoundError:
        return Finding(name, "fail", f"is not installed; run `pip install '{name}'`")


def loads() -> Iterator[Finding]:
    """Load compiled packages, where they are installed, in processes of their own.

    A broken one may end its process.
    """
    for name, module in _NATIVE.items():
        if _package(name).verdict == "ok":
            yield _loaded(name, module)


def _loaded(name: str, module: str) -> Finding:
    what, words = f"load {name}", [sys.executable, "-c", f"import {module}"]
    try:
        done = subprocess.run(
            words, check=False, capture_output=True, text=True, timeout=_LOAD_DEADLINE_S
        )
    except subprocess.TimeoutExpired:
        text = f"not finished after {_LOAD_DEADLINE_S:g} s; is the disk or the machine overloaded?"
        return Finding(what, "fail", text)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        hint = import_error_hint(last) or f"; run `pip install --force-reinstall {name}`"
        return Finding(what, "fail", last + hint)
    return Finding(what, "ok", "works")


def extras() -> Iterator[Finding]:
    """Yield a finding for each extra: its purpose, missing packages, the command to install it."""
    with contextlib.suppress(PackageNotFoundError):
        for extra, text in EXTRAS.items():
            lacking = [name for name in needed(extra) if _package(name).verdict != "ok"]
            missing = f"; missing {', '.join(lacking)}: `{install_command(extra)}`"
            verdict: Verdict = "warn" if lacking else "ok"
            yield Finding(f"extra {extra}", verdict, text + (missing if lacking else ""))


# --- the bus -----------------------------------------------------------------------------------


def link(transport: Literal["unix", "tcp"]) -> Finding:
    """Pass a message between two sessions, linked as those of a run are."""
    what = f"bus, {transport}"
    scenario = Scenario(
        name="doctor",
        step_ns=1,
        steps=None,
        seed=0,
        participants=(),
        bus=BusSpec(transport=transport),
        folder=Path(),
        file=Path(),
    )
    try:
        with (
            tempfile.TemporaryDirectory(prefix="stepbus-") as folder,
            contextlib.ExitStack() as held,
        ):
            mesh = make_mesh(scenario, Path(folder), None, held)
            took_s = _pass_message(mesh.orchestrator, mesh.caller)
    except (BusError, BusFailed, Empty, OSError) as exc:
        reason = str(exc) or f"none within {_BUS_DEADLINE_S:g} s; does a firewall block loopback?"
        return Finding(what, "fail", f"no message arrived: {reason}")
    return Finding(what, "ok", f"message received {took_s:.2f} s after start")


def _pass_message(one: Endpoint, other: Endpoint) -> float:
    """Return how long it took from the first session to the message [s]."""
    began = time.monotonic()
    inbox: SimpleQueue[Any] = SimpleQueue()
    with closing(ZenohBus(one, "doctor")) as sender, closing(ZenohBus(other, "doctor")) as receiver:
        receiver.subscribe("hello", inbox.put)
        put = sender.publisher("hello", "text/plain")
        give_up = time.monotonic() + _BUS_DEADLINE_S
        while time.monotonic() < give_up:
            put(b"hello")
            with contextlib.suppress(Empty):
                inbox.get(timeout=_AGAIN_S)
                return time.monotonic() - began
    raise Empty
