"""Reads a table of numbers from a CSV file, and reports every mistake with its line."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

from stepbus_mission.params import Params
from stepbus_participant import read_text, suggest
from stepbus_schemas import JointReference, WiringError

_DERIVATIVES = ("velocity", "acceleration")
_MOST_PROBLEMS = 10


@dataclass(frozen=True, kw_only=True)
class Table:
    """times: increasing, shape (k,), k ≥ 2 [s]. columns: name → numbers, shape (k,)."""

    times: list[float]
    columns: dict[str, list[float]]


def read_table(path: Path, joints: Sequence[str]) -> Table:
    """Return the columns `t`, `<joint>`, `<joint>_velocity` and `<joint>_acceleration` of a file.

    Raises WiringError that lists all mistakes, each with file and line.
    """
    try:
        reader = csv.reader(io.StringIO(read_text(path, "utf-8-sig")))
        lines = [(reader.line_num, row) for row in reader if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as exc:
        raise WiringError(f"{path} cannot be read as CSV: {exc}") from exc
    if len(lines) < 3:
        raise WiringError(f"{path} has {len(lines)} lines; it needs a header and at least two rows")
    header = [cell.strip() for cell in lines[0][1]]
    _refuse(path, _header_problems(header, joints, lines[0][0]))
    problems: list[tuple[int, str]] = []
    rows = [_numbers(row, header, number, problems) for number, row in lines[1:]]
    _refuse(path, problems)
    columns = {name: [row[i] for row in rows] for i, name in enumerate(header)}
    times = columns.pop("t")
    _refuse(path, _time_problems(times, [number for number, _ in lines[1:]]))
    return Table(times=times, columns=columns)


def _header_problems(
    header: Sequence[str], joints: Sequence[str], line: int
) -> list[tuple[int, str]]:
    known = ["t", *joints]
    known += [f"{joint}_{quantity}" for joint in joints for quantity in _DERIVATIVES]
    problems = [
        f"column {name!r} is unknown{suggest(name, known)}"
        for name in dict.fromkeys(header)
        if name not in known
    ]
    problems += [f"column {name!r} is missing" for name in ("t", *joints) if name not in header]
    problems += [
        f"column {name!r} occurs {header.count(name)} times"
        for name in dict.fromkeys(header)
        if header.count(name) > 1
    ]
    problems += [
        f"column '{joint}_acceleration' needs '{joint}_velocity' too"
        for joint in joints
        if f"{joint}_acceleration" in header and f"{joint}_velocity" not in header
    ]
    return [(line, problem) for problem in problems]


def _numbers(
    row: Sequence[str], header: Sequence[str], line: int, problems: list[tuple[int, str]]
) -> list[float]:
    """Return a row as numbers, and add its mistakes to `problems`."""
    if len(row) != len(header):
        problems.append((line, f"has {len(row)} cells, the header has {len(header)}"))
    numbers = []
    for name, cell in zip(header, row, strict=False):
        number = _number(cell)
        if not math.isfinite(number):
            problems.append((line, f"column {name!r} is {cell!r}, not a finite number"))
        numbers.append(number)
    return numbers


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _time_problems(times: Sequence[float], lines: Sequence[int]) -> list[tuple[int, str]]:
    problems = [(lines[0], f"t starts at {times[0]:g} s, before 0")] if times[0] < 0 else []
    problems += [
        (line, f"t is {now:g} s, not after the row before ({before:g} s)")
        for (before, now), line in zip(pairwise(times), lines[1:], strict=True)
        if now <= before
    ]
    return problems


def _refuse(path: Path, problems: Sequence[tuple[int, str]]) -> None:
    if not problems:
        return
    sentences = [f"{path}:{line}: {text}" for line, text in problems[:_MOST_PROBLEMS]]
    if len(problems) > _MOST_PROBLEMS:
        sentences.append(f"{path}: and {len(problems) - _MOST_PROBLEMS} more")
    raise WiringError("\n".join(sentences))


class Generator(Protocol):
    """The interface of a reference generator, built-in or your own.

    The constructor takes the joints and the parameters: those of the mission, or those that its own
    class `Params` declares. A generator that ends has an attribute `duration` [s]; after it, the
    reference is at rest.
    """

    def __init__(self, joints: Sequence[str], params: Any) -> None: ...

    def at(self, t: float, /) -> JointReference:
        """Return position, velocity and acceleration of every joint.

        t: simulation time [s]. Vectors have shape (n,), in the order of `joints`; velocity and
        acceleration are the exact derivatives of the position.
        """
        ...


SineRow = tuple[float, float, float, float, float]
"""Of one joint: amplitude [rad], omega [rad/s], phase, offset, and the angle that changes of omega
have added to the phase [rad]."""


class Sine:
    """q(t) = offset + amplitude · sin(omega t + phase), per joint."""

    def __init__(self, joints: Sequence[str], params: Params) -> None:
        self._shift = (0.0,) * len(joints)
        self._rows = tuple(
            zip(
                params.amplitude.of(joints),
                params.omega.of(joints),
                params.phase.of(joints),
                params.offset.of(joints),
                strict=True,
            )
        )

    def changed(self, joints: Sequence[str], params: Params, t: float) -> Sine:
        """Return the sine of other parameters from a time on [s]; another omega keeps the angle."""
        sine = Sine(joints, params)
        omegas = [(row[1], new[1]) for row, new in zip(self._rows, sine._rows, strict=True)]
        sine._shift = tuple(
            shift + (before - now) * t
            for shift, (before, now) in zip(self._shift, omegas, strict=True)
        )
        sine._rows = tuple(
            (amplitude, omega, phase + shift, offset)
            for (amplitude, omega, phase, offset), shift in zip(
                sine._rows, sine._shift, strict=True
            )
        )
        return sine

    def save(self) -> list[SineRow]:
        """Return a row for each joint, for a checkpoint."""
        return [(*row, shift) for row, shift in zip(self._rows, self._shift, strict=True)]

    def restore(self, rows: Sequence[SineRow]) -> None:
        """Take what `save` returned."""
        self._rows = tuple(row[:4] for row in rows)
        self._shift = tuple(row[4] for row in rows)

    def at(self, t: float) -> JointReference:
        """See `Generator`."""
        position, velocity, acceleration = [], [], []
        for amplitude, omega, phase, offset in self._rows:
            angle = omega * t + phase
            swing = amplitude * math.sin(angle)
            position.append(offset + swing)
            velocity.append(amplitude * omega * math.cos(angle))
            acceleration.append(-omega * omega * swing)
        return JointReference(position=position, velocity=velocity, acceleration=acceleration)


class StepChange:
    """Jumps from `initial` to `target` at `time`; its derivatives are zero."""

    def __init__(self, joints: Sequence[str], params: Params) -> None:
        self._time = params.time
        self._before = at_rest(params.initial.of(joints))
        self._after = at_rest(params.target.of(joints))

    def at(self, t: float) -> JointReference:
        """See `Generator`."""
        return self._before if t < self._time else self._after


def at_rest(position: Sequence[float]) -> JointReference:
    """Return a constant reference; position: shape (n,) [rad]."""
    zeros = [0.0] * len(position)
    return JointReference(position=list(position), velocity=zeros, acceleration=zeros)
