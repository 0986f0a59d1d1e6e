"""What became of the commands of the self-test: a verdict per joint."""

import math
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from stepbus_tools.selftest.tester import TestedJoint, Trial
from stepbus_tools.signals import Array, Signal

# How far from its goal a joint may end, and how far another may move meanwhile [rad, m].
_CLOSE = {True: math.radians(0.5), False: 0.0005}
_STILL = {True: math.radians(1.0), False: 0.001}
# A joint put somewhere in mode torque or teleport falls for one step before it is measured.
_FALLEN = {True: math.radians(2.0), False: 0.005}
_FREE = ("torque", "teleport")


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """What the self-test found out about one joint.

    commanded, measured: positions [rad or m]; None for a joint without a motor. others: which
    other joint moved most, and how far. findings: what is wrong, a sentence each; ok: nothing is,
    to one side at least. other_side: what went wrong there.
    """

    joint: str
    type: str
    mode: str
    commanded: float | None = None
    measured: float | None = None
    others: tuple[str, float] | None = None
    ok: bool = True
    findings: list[str] = []
    other_side: str = ""

    def shown(self, value: float) -> str:
        """Return a position of the joint, or a way, in units for people."""
        return shown(value, is_rotary=self.type != "prismatic")


def shown(value: float, *, is_rotary: bool) -> str:
    """Return an angle in degrees, or a length in millimetres."""
    return f"{math.degrees(value):.2f}°" if is_rotary else f"{1e3 * value:.2f} mm"


def judge(joints: Sequence[TestedJoint], plan: Sequence[Trial], state: Signal) -> list[Verdict]:
    """Return a verdict for every joint.

    state: what was measured, one sample for each step of the tester.
    """
    return [
        best([_Evidence(t, joints, state).verdict() for t in plan if t.joint is joint])
        or Verdict(joint=joint.name, type=joint.type, mode=joint.mode)
        for joint in joints
    ]


def best(verdicts: Sequence[Verdict]) -> Verdict | None:
    """Return the first verdict without findings, or else the first, with what the others found."""
    chosen = next((v for v in verdicts if v.ok), None) or next(iter(verdicts), None)
    if chosen is None:
        return None
    texts: list[str] = []
    for verdict in verdicts:
        is_rotary = verdict.type != "prismatic"
        where = f"sent to {verdict.shown(verdict.commanded or 0.0)}" if is_rotary else "else"
        if verdict is not chosen:
            texts += [f"{where} it {finding}" for finding in verdict.findings]
        texts.append(verdict.other_side)
    return msgspec.structs.replace(chosen, other_side="; ".join(filter(None, texts)))


class _Evidence:
    """One trial and its measurements, each of shape (n,), by the index of the joint.

    before, after: positions. speed, effort: largest values meanwhile, NaN where not sensed.
    """

    def __init__(self, trial: Trial, joints: Sequence[TestedJoint], state: Signal) -> None:
        self.trial, self.joint = trial, trial.joint
        self._joints, self._state = joints, state
        self._position = state.fields["position"]
        self.before, self.after = self._position[trial.first], self._position[trial.measure]
        self._moved = self.after - self.before
        self._speed, self._effort = self._largest("velocity"), self._largest("effort")

    def _largest(self, quantity: str) -> Array:
        rows = [self._state.of(quantity, joint.name) for joint in self._joints]
        span = slice(self.trial.first, self.trial.measure + 1)
        return np.array([math.nan if row is None else np.abs(row[span]).max() for row in rows])

    def verdict(self) -> Verdict:
        """Return the verdict on the joint of the trial."""
        joint = self.joint
        others = None if joint.mode in _FREE else self._moved_most()
        findings = [
            *(self._pushed() if joint.mode == "torque" else ()),
            *self._arrived(),
            *(self._moved_too(*others) if others else ()),
            *self._beyond(),
        ]
        return Verdict(
            joint=joint.name,
            type=joint.type,
            mode=joint.mode,
            commanded=self.trial.goal,
            measured=float(self.after[joint.index]),
            others=None if others is None else (others[0].name, others[1]),
            ok=not findings,
            findings=findings,
        )

    def _arrived(self) -> Iterator[str]:
        """Describe how the joint missed its goal: still, wrong direction or unit, or short."""
        joint, goal = self.joint, self.trial.goal
        mine, measured = float(self._moved[joint.index]), float(self.after[joint.index])
        wanted = goal - float(self.before[joint.index])
        weak = f"; its motor was at its limit of {_effort(joint)}: is it too weak, or"
        why = f"{weak if self._is_at_limit(joint) else ';'} is something in its way?"
        if abs(measured - goal) <= _margin(joint):
            return
        if joint.is_rotary and math.isclose(measured, math.degrees(goal), rel_tol=0.02):
            yield f"reads {measured:.1f} for {goal:.4f} rad; does it measure in degrees?"
        elif joint.is_rotary and math.isclose(mine, math.radians(wanted), rel_tol=0.1):
            yield "moves 1/57 of the way; does it interpret radians as degrees?"
        elif abs(mine) < 0.1 * abs(wanted):
            instead = [
                j.name
                for j in self._joints
                if j is not joint and math.isclose(self._moved[j.index], wanted, rel_tol=0.2)
            ]
            swapped = f"; {', '.join(instead)} moves instead: are they swapped?"
            yield f"does not move{swapped if instead else why}"
        elif mine * wanted < 0:
            yield f"moves in the other direction, by {shown(mine, is_rotary=joint.is_rotary)}"
        else:
            short = shown(abs(measured - goal), is_rotary=joint.is_rotary)
            yield f"stops {short} from its target{why}"

    def _is_at_limit(self, joint: TestedJoint) -> bool:
        return bool(self._effort[joint.index] >= 0.999 * joint.effort)

    def _pushed(self) -> Iterator[str]:
        """Say whether a push forward moves it further than a push back, and the applied torque."""
        joint, (forward, back) = self.joint, self.trial.pushes
        position = self._position[:, joint.index]
        if not position[forward] > position[back]:
            yield "a positive torque does not move it in the positive direction"
        effort = self._state.of("effort", joint.name)
        for place, torque in ((forward, joint.push), (back, -joint.push)):
            if effort is not None and not math.isclose(effort[place], torque, rel_tol=1e-3):
                applied = f"{effort[place]:.3g} {joint.units[0]}"
                yield f"applies {applied} instead of the commanded {torque:.3g}"

    def _moved_most(self) -> tuple[TestedJoint, float] | None:
        """Return (joint, way) of the held joint that moved most; None where no joint is held."""
        held = [
            (j, float(abs(self._moved[j.index])))
            for j in self._joints
            if j is not self.joint and j.effort > 0 and j.mode in ("position", "velocity")
        ]
        return max(held, key=lambda row: row[1], default=None)

    def _moved_too(self, other: TestedJoint, way: float) -> Iterator[str]:
        """Say that a joint that is held has moved as well, where it has."""
        if way > _STILL[other.is_rotary]:
            pushed = f", whose motor was at its limit of {_effort(other)}: does something push it?"
            tail = pushed if self._is_at_limit(other) else ""
            yield f"moves {other.name} as well, by {shown(way, is_rotary=other.is_rotary)}{tail}"

    def _beyond(self) -> Iterator[str]:
        """Say which of its limits the joint has passed."""
        joint, end = self.joint, float(self.after[self.joint.index])
        if not joint.lower - _margin(joint) <= end <= joint.upper + _margin(joint):
            yield f"is at {end:.4f}, beyond its limits [{joint.lower:g}, {joint.upper:g}]"
        speed, effort = self._speed[joint.index], self._effort[joint.index]
        if joint.mode not in _FREE and speed > 1.1 * joint.speed:
            yield f"moves at {speed:.2f} {joint.units[1]}, beyond its limit of {joint.speed:g}"
        if effort > 1.001 * joint.effort:
            yield f"applies {effort:.3g}, beyond its limit of {joint.effort:g}"


def _margin(joint: TestedJoint) -> float:
    """Return how far from its goal a joint may end [rad or m]."""
    return (_FALLEN if joint.mode in _FREE else _CLOSE)[joint.is_rotary]


def _effort(joint: TestedJoint) -> str:
    return f"{joint.effort:g} {joint.units[0]}"
