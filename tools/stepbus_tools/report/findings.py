"""What a recording shows to be at or beyond a known limit: torques, targets beyond a stop."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stepbus_orchestrator.recording import Port, Recording
from stepbus_orchestrator.recording.layout import split_topic
from stepbus_schemas import Description, Goal
from stepbus_tools.columns import limits_of
from stepbus_tools.signals import Array, Signal, read_signal

STATE, COMMAND, REFERENCE = "JointState/1", "JointCommand/1", "JointReference/1"
_TOLERANCE = 1e-6
_OFTEN = 0.1


@dataclass(frozen=True)
class Joint:
    """Limits of one joint, as its plant describes them, in SI units."""

    lower: float = -math.inf
    upper: float = math.inf
    effort: float = math.inf
    type: str = ""

    @property
    def is_rotary(self) -> bool:
        """Return whether it turns."""
        return self.type != "prismatic"


@dataclass
class Count:
    """How often the values of one joint were at a limit (full) or beyond it (cut).

    worst: the farthest beyond.
    """

    messages: int = 0
    cut: int = 0
    full: int = 0
    worst: float = 0.0

    def take(self, values: Array, lower: float, upper: float, slack: float = _TOLERANCE) -> None:
        """Count values, shape (n,), of which some may be no numbers."""
        beyond = (values < lower - slack) | (values > upper + slack)
        self.messages += len(values)
        self.cut += int(np.count_nonzero(beyond))
        if lower < upper:
            full = (values <= lower + slack) | (values >= upper - slack)
            self.full += int(np.count_nonzero(full))
        if beyond.any():
            farthest = float(max(values[beyond], key=abs))
            self.worst = max(self.worst, farthest, key=abs)

    @property
    def share(self) -> str:
        """Return in how many of the steps values were cut."""
        return f"{math.ceil(100 * self.cut / self.messages)} % of the steps"


@dataclass
class _Watched:
    """A port whose values have limits.

    receiver: who applies them; empty for a reference. own: limits of the sender, by joint.
    has_targets: whether positions are checked too.
    """

    port: Port
    receiver: str
    joints: Mapping[str, Joint]
    own: Mapping[str, float]
    has_targets: bool = True
    torques: dict[str, Count] = field(default_factory=dict)
    targets: dict[str, Count] = field(default_factory=dict)

    def take(self, signal: Signal) -> None:
        modes = signal.modes - {"brake"}
        for name in signal.names:
            joint = self.joints.get(name)
            if joint is None:
                continue
            if self.port.type == REFERENCE or (modes == {"position"} and self.has_targets):
                quantity = "position" if self.port.type == REFERENCE else "values"
                if (values := signal.of(quantity, name)) is not None:
                    self.targets.setdefault(name, Count()).take(values, joint.lower, joint.upper)
            elif modes == {"torque"} and (values := signal.of("values", name)) is not None:
                limit = min(joint.effort, self.own.get(name, math.inf))
                slack = limit * _TOLERANCE if math.isfinite(limit) else 0.0
                self.torques.setdefault(name, Count()).take(values, -limit, limit, slack)

    def lines(self) -> Iterator[str]:
        who = self.port.topic.replace("/", ".", 1)
        for name, count in self.torques.items():
            joint = self.joints[name]
            unit = "N·m" if joint.is_rotary else "N"
            if count.cut:
                yield (
                    f"{self.receiver} clips {name} of {who} to {joint.effort:g} {unit} "
                    f"in {count.share}: up to {abs(count.worst):.4g} {unit} were "
                    "commanded"
                )
            elif count.full > _OFTEN * count.messages:
                share = math.floor(100 * count.full / count.messages)
                yield f"{who}: {name} is saturated in {share} % of the steps"
        for name, count in self.targets.items():
            if count.cut:
                yield f"{who}: {_beyond(name, self.joints[name], count)}"


def _beyond(name: str, joint: Joint, count: Count) -> str:
    unit = "rad" if joint.is_rotary else "m"
    stop = joint.lower if count.worst < joint.lower else joint.upper
    return f"{name} is commanded to {count.worst:.4g} {unit}, beyond its stop at {stop:.4g} {unit}"


def findings(recording: Recording) -> list[str]:
    """Return what a recording shows to be at or beyond a limit, one sentence each."""
    rows = recording.scenario.get("participants")
    plants = {
        split_topic(port.topic)[0]: _joints(port.description)
        for port in recording.of_type(STATE)
        if port.description.limits
    }
    watched = list(_watched(recording, rows if isinstance(rows, dict) else {}, plants))
    for batch in recording.batches([row.port for row in watched]):
        for row in watched:
            quantities = ("position",) if row.port.type == REFERENCE else ("mode", "values")
            signal = read_signal(row.port, batch[row.port.topic], quantities)
            if signal is not None:
                row.take(signal)
    return [
        *(line for row in watched for line in row.lines()),
        *_goal_lines(recording, plants.values()),
    ]


def _goal_lines(recording: Recording, plants: Iterable[Mapping[str, Joint]]) -> Iterator[str]:
    """Yield the joints that goals send beyond a stop."""
    joints = {name: joint for plant in plants for name, joint in plant.items()}
    # Goals name joints as the model does, without the prefix of one of two robots.
    joints = {name.rpartition("/")[2]: joint for name, joint in joints.items()} | joints
    counts: dict[tuple[str, str], Count] = {}
    for port in recording.of_type("Goal/1"):
        topic = port.topic.replace("/", ".", 1)
        goals = (goal for _, goal in port.messages() if isinstance(goal, Goal))
        targets = (pair for goal in goals for pair in zip(goal.joints, goal.values, strict=False))
        for name, value in targets:
            if name in joints:
                count = counts.setdefault((topic, name), Count())
                count.take(np.array([value]), joints[name].lower, joints[name].upper)
    for (topic, name), count in counts.items():
        if count.cut:
            yield f"{topic}: {_beyond(name, joints[name], count)}"


def _sources(row: Any) -> set[str]:
    """Return the topics that a participant reads."""
    inputs = row.get("inputs") if isinstance(row, dict) else None
    items = inputs.values() if isinstance(inputs, dict) else ()
    origins = (item.get("from", "") if isinstance(item, dict) else item for item in items)
    return {str(origin).replace(".", "/", 1) for origin in origins}


def _watched(
    recording: Recording, rows: Mapping[str, Any], plants: Mapping[str, Mapping[str, Joint]]
) -> Iterator[_Watched]:
    """Yield the ports with limits: commands with those of their plant, references with all.

    Targets of plants that report events are left out: these warn of them by themselves.
    """
    reporting = {split_topic(port.topic)[0] for port in recording.of_type("Event/1")}
    for port in recording.of_type(COMMAND):
        efforts = port.description.limits.get("effort", ())
        own = dict(zip(port.names, efforts, strict=False))
        for name, joints in plants.items():
            if port.topic in _sources(rows.get(name, {})):
                yield _Watched(port, name, joints, own, has_targets=name not in reporting)
    silent = (joints for name, joints in plants.items() if name not in reporting)
    every = {name: joint for joints in silent for name, joint in joints.items()}
    for port in recording.of_type(REFERENCE):
        yield _Watched(port, "", every, {})


def _joints(description: Description) -> dict[str, Joint]:
    limits, names = description.limits, description.names
    types = description.details.get("type") or [""] * len(names)
    return {
        name: Joint(
            *limits_of(limits, "position", number), limits_of(limits, "effort", number)[1], type_
        )
        for number, (name, type_) in enumerate(zip(names, types, strict=False))
    }
