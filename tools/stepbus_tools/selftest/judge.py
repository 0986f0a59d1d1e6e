"""What became of the commands of the self-test: a verdict per joint."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True, kw_only=True)
class _Evidence:
    """What was measured in one trial, by the index of the joint.

    Each of shape (n,). before, after: positions. speed, effort: largest ones meanwhile, NaN where
    not sensed.
    """

    before: Array
    after: Array
    speed: Array
    effort: Array


def judge(joints: Sequence[TestedJoint], plan: Sequence[Trial], state: Signal) -> list[Verdict]:
    """Return a verdict for every joint.

    state: what was measured, one sample for each step of the tester.
    """
    return [
        best([_verdict(trial, joints, state) for trial in plan if trial.joint is joint])
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


def _verdict(trial: Trial, joints: Sequence[TestedJoint], state: Signal) -> Verdict:
    joint = trial.joint
    evidence = _evidence(state, joints, trial)
    others = None if joint.mode in _FREE else _moved_most(joint, joints, evidence)
    findings = [
        *(_pushed(trial, state) if joint.mode == "torque" else ()),
        *_arrived(trial, joints, evidence),
        *(_moved_too(*others, evidence) if others else ()),
        *_beyond(joint, evidence),
    ]
    return Verdict(
        joint=joint.name,
        type=joint.type,
        mode=joint.mode,
        commanded=trial.goal,
        measured=float(evidence.after[joint.index]),
        others=None if others is None else (others[0].name, others[1]),
        ok=not findings,
        findings=findings,
    )


def _evidence(state: Signal, joints: Sequence[TestedJoint], trial: Trial) -> _Evidence:
    def largest(quantity: str) -> Array:
        rows = [state.of(quantity, joint.name) for joint in joints]
        span = slice(trial.first, trial.measure + 1)
        return np.array([math.nan if row is None else np.abs(row[span]).max() for row in rows])

    position = state.fields["position"]
    return _Evidence(
        before=position[trial.first],
        after=position[trial.measure],
        speed=largest("velocity"),
        effort=largest("effort"),
    )


def _margin(joint: TestedJoint) -> float:
    """Return how far from where it should be a joint may end [rad or m]."""
    return (_FALLEN if joint.mode in _FREE else _CLOSE)[joint.is_rotary]


def _arrived(trial: Trial, joints: Sequence[TestedJoint], evidence: _Evidence) -> Iterator[str]:
    """Describe how a joint missed its goal: still, other direction, another unit, or short."""
    joint = trial.joint
    moved = evidence.after - evidence.before
    mine = float(moved[joint.index])
    wanted = trial.goal - float(evidence.before[joint.index])
    measured = float(evidence.after[joint.index])
    weak = f"; its motor was at its limit of {_effort(joint)}: is it too weak, or"
    why = f"{weak if _is_at_limit(joint, evidence) else ';'} is something in its way?"
    if abs(measured - trial.goal) <= _margin(joint):
        return
    if joint.is_rotary and math.isclose(measured, math.degrees(trial.goal), rel_tol=0.02):
        yield f"reads {measured:.1f} for {trial.goal:.4f} rad; does it measure in degrees?"
    elif joint.is_rotary and math.isclose(mine, math.radians(wanted), rel_tol=0.1):
        yield "moves 1/57 of the way; does it interpret radians as degrees?"
    elif abs(mine) < 0.1 * abs(wanted):
        instead = [
            j.name
            for j in joints
            if j is not joint and math.isclose(float(moved[j.index]), wanted, rel_tol=0.2)
        ]
        swapped = f"; {', '.join(instead)} moves instead: are they swapped?"
        yield f"does not move{swapped if instead else why}"
    elif mine * wanted < 0:
        yield f"moves in the other direction, by {shown(mine, is_rotary=joint.is_rotary)}"
    else:
        short = shown(abs(measured - trial.goal), is_rotary=joint.is_rotary)
        yield f"stops {short} from its target{why}"


def _is_at_limit(joint: TestedJoint, evidence: _Evidence) -> bool:
    return bool(evidence.effort[joint.index] >= 0.999 * joint.effort)


def _effort(joint: TestedJoint) -> str:
    return f"{joint.effort:g} {joint.units[0]}"


def _pushed(trial: Trial, state: Signal) -> Iterator[str]:
    """Say whether a push forward moves it further forward than one back, and what was applied."""
    joint, (forward, back) = trial.joint, trial.pushes
    position = state.fields["position"][:, joint.index]
    if not position[forward] > position[back]:
        yield "a positive torque does not move it in the positive direction"
    effort = state.of("effort", joint.name)
    for place, torque in ((forward, joint.push), (back, -joint.push)):
        if effort is not None and not math.isclose(effort[place], torque, rel_tol=1e-3):
            applied = f"{effort[place]:.3g} {joint.units[0]}"
            yield f"applies {applied} instead of the commanded {torque:.3g}"


def _moved_most(
    joint: TestedJoint, joints: Sequence[TestedJoint], evidence: _Evidence
) -> tuple[TestedJoint, float] | None:
    """Return which of the joints that are held moved most, and how far."""
    moved = np.abs(evidence.after - evidence.before)
    held = [
        (j, float(moved[j.index]))
        for j in joints
        if j is not joint and j.effort > 0 and j.mode in ("position", "velocity")
    ]
    return max(held, key=lambda row: row[1], default=None)


def _moved_too(other: TestedJoint, way: float, evidence: _Evidence) -> Iterator[str]:
    """Say that a joint that is held has moved as well, where it has."""
    if way > _STILL[other.is_rotary]:
        pushed = f", whose motor was at its limit of {_effort(other)}: does something push it?"
        tail = pushed if _is_at_limit(other, evidence) else ""
        yield f"moves {other.name} as well, by {shown(way, is_rotary=other.is_rotary)}{tail}"


def _beyond(joint: TestedJoint, evidence: _Evidence) -> Iterator[str]:
    """Say which of its limits a joint has passed."""
    end = float(evidence.after[joint.index])
    if not joint.lower - _margin(joint) <= end <= joint.upper + _margin(joint):
        yield f"is at {end:.4f}, beyond its limits [{joint.lower:g}, {joint.upper:g}]"
    speed, effort = evidence.speed[joint.index], evidence.effort[joint.index]
    if joint.mode not in _FREE and speed > 1.1 * joint.speed:
        yield f"moves at {speed:.2f} {joint.units[1]}, beyond its limit of {joint.speed:g}"
    if effort > 1.001 * joint.effort:
        yield f"applies {effort:.3g}, beyond its limit of {joint.effort:g}"
