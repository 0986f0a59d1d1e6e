"""What the tests of scenarios share: a small scenario that works, and changes to it."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario

TWO_LINK = """\
name: arm
step: 5ms
duration: 10s
participants:
  plant:
    exec: [python, -c, pass]
    publishes: first
    inputs: {command: controller.command}
    outputs: {joint_state: JointState/1}
  controller:
    exec: [python, -c, pass]
    inputs: {joint_state: plant.joint_state, reference: mission.reference}
    outputs: {command: JointCommand/1, status: ControllerStatus/1}
    params: {law: pd, kp: 100}
  mission:
    exec: [python, -c, pass]
    every: 4
    inputs: {joint_state: {from: plant.joint_state, delay: 1}}
    outputs: {reference: JointReference/1}
"""


@cache
def shipped(name: str) -> Scenario:
    """Return a scenario that ships, which is frozen: the larger ones take half a second to load."""
    return load(name)


def write(folder: Path, text: str = TWO_LINK, name: str = "scenario.yaml") -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def load_text(folder: Path, text: str = TWO_LINK, *overrides: str) -> Scenario:
    return load(write(folder, text), overrides)


def problems_of(folder: Path, text: str = TWO_LINK, *overrides: str) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        load_text(folder, text, *overrides)
    return str(caught.value).splitlines()


def problem_of(folder: Path, text: str = TWO_LINK, *overrides: str) -> str:
    (problem,) = problems_of(folder, text, *overrides)
    return problem


def changed(old: str, new: str) -> str:
    assert old in TWO_LINK
    return TWO_LINK.replace(old, new, 1)


def plain() -> dict[str, Any]:
    data: dict[str, Any] = YAML(typ="safe", pure=True).load(TWO_LINK)
    return data


def wiring(text: str) -> str:
    """Return a scenario from lines such as `a.x <- b.o` or `a.x <- b.o -1` (delayed by 1)."""
    inputs: dict[str, list[str]] = {}
    for line in filter(None, map(str.strip, text.splitlines())):
        target, _, origin = line.partition(" <- ")
        source, _, delay = origin.partition(" -")
        reader, _, port = target.partition(".")
        inputs.setdefault(source.partition(".")[0], [])
        inputs.setdefault(reader, []).append(f"{port}: {{from: {source}, delay: {delay or 0}}}")
    rows = [
        f"  {name}: {{exec: [python, -c, pass], inputs: {{{', '.join(inputs[name])}}}, "
        "outputs: {o: Event/1}}"
        for name in sorted(inputs)
    ]
    return "\n".join(["name: wiring", "step: 1ms", "duration: 6ms", "participants:", *rows])
