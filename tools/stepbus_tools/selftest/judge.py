"""What became of the commands of the self-test: a verdict per joint."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from stepbus_orchestrator.analysis.signals import Array, Signal
from stepbus_selftest import TestedJoint, Trial

# How far from its goal a joint may end, and how far another may move meanwhile [rad, m].
_CLOSE = {True: math.radians(0.5), False: 0.0005}
_STILL = {True: math.radians(1.0), False: 0.001}
# A joint put somewhere in mode torque or teleport falls for one step before it is measured.
_FALLEN = {True: math.radians(2.0), False: 0.005}


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


def better(verdicts: Sequence[Verdict], others: Sequence[Verdict]) -> list[Verdict]:
    """Return for each joint the better of its verdicts, with what went wrong in the other.

    others: of some of the joints, by the same plant at another angle.
    """
    again = {verdict.joint: verdict for verdict in others}
    return [
        _merged(verdict, again[verdict.joint]) if verdict.joint in again else verdict
        for verdict in verdicts
    ]


def _merged(first: Verdict, second: Verdict) -> Verdict:
    if not second.ok:
        return first
    rows = (
        *(_finding(first, text) for text in first.findings),
        first.other_side,
        second.other_side,
    )
    return msgspec.structs.replace(second, other_side="; ".join(filter(None, rows)))


def judge(joints: Sequence[TestedJoint], plan: Sequence[Trial], state: Signal) -> list[Verdict]:
    """Return a verdict for every joint.

    state: what was measured, one sample for each step of the tester.
    """
    return [
        _best([_verdict(joint, t, joints, state) for t in plan if t.joint is joint])
        or Verdict(joint=joint.name, type=_joint_type(joint), mode=joint.mode)
        for joint in joints
    ]


def _best(verdicts: Sequence[Verdict]) -> Verdict | None:
    """Return the first verdict without findings, or else the first; None where there is none."""
    best = next((verdict for verdict in verdicts if verdict.ok), None) or next(iter(verdicts), None)
    other_side = "; ".join(
        _finding(verdict, text)
        for verdict in verdicts
        for text in verdict.findings
        if verdict is not best
    )
    return best if best is None else msgspec.structs.replace(best, other_side=other_side)


def _finding(verdict: Verdict, finding: str) -> str:
    goal = verdict.commanded or 0.0
    is_rotary = verdict.type != "prismatic"
    return f"sent to {math.degrees(goal):.2f}° it {finding}" if is_rotary else f"else it {finding}"


def _verdict(
    joint: TestedJoint, trial: Trial, joints: Sequence[TestedJoint], state: Signal
) -> Verdict:
    free = joint.mode in ("torque", "teleport")
    at = trial.jump + 1 if free else trial.measure
    evidence = _evidence(state, joints, trial.first, at)
    others = None if free else _moved_most(joint, joints, evidence)
    findings = [
        *(_pushed(joint, trial, state) if joint.mode == "torque" else ()),
        *_arrived(trial, joints, evidence, _FALLEN if free else _CLOSE),
        *_others(others, joints, evidence),
        *_limits(joint, evidence, free=free),
    ]
    return Verdict(
        joint=joint.name,
        type=_joint_type(joint),
        mode=joint.mode,
        commanded=trial.goal,
        measured=float(evidence.after[joint.index]),
        others=others,
        ok=not findings,
        findings=findings,
    )


def _joint_type(joint: TestedJoint) -> str:
    return "revolute" if joint.is_rotary else "prismatic"


def _evidence(state: Signal, joints: Sequence[TestedJoint], first: int, at: int) -> _Evidence:
    def largest(quantity: str) -> Array:
        rows = [state.of(quantity, joint.name) for joint in joints]
        return np.array(
            [math.nan if row is None else np.abs(row[first : at + 1]).max() for row in rows]
        )

    position = state.fields["position"]
    return _Evidence(
        before=position[first],
        after=position[at],
        speed=largest("velocity"),
        effort=largest("effort"),
    )


def _arrived(
    trial: Trial, joints: Sequence[TestedJoint], evidence: _Evidence, close: dict[bool, float]
) -> Iterator[str]:
    """Describe how a joint missed its goal: still, other direction, another unit, or short."""
    joint = trial.joint
    moved = evidence.after - evidence.before
    mine = float(moved[joint.index])
    wanted = trial.goal - float(evidence.before[joint.index])
    measured = float(evidence.after[joint.index])
    if abs(measured - trial.goal) <= close[joint.is_rotary]:
        return
    if joint.is_rotary and math.isclose(measured, math.degrees(trial.goal), rel_tol=0.02):
        yield f"reads {measured:.1f} for {trial.goal:.4f} rad; does it measure in degrees?"
    elif joint.is_rotary and math.isclose(mine, math.radians(wanted), rel_tol=0.1):
        yield "moves 1/57 of the way; does it take radians for degrees?"
    elif abs(mine) < 0.1 * abs(wanted):
        instead = [
            j.name
            for j in joints
            if j is not joint and math.isclose(float(moved[j.index]), wanted, rel_tol=0.2)
        ]
        tail = f"; {', '.join(instead)} moves in its place: are they swapped?" if instead else ""
        yield f"does not move{tail or _at_its_limit(joint, evidence)}"
    elif mine * wanted < 0:
        yield f"moves in the other direction, by {_amount(joint, mine)}"
    else:
        end = _amount(joint, abs(measured - trial.goal))
        yield f"ends {end} from where it was sent{_at_its_limit(joint, evidence)}"


def _at_its_limit(joint: TestedJoint, evidence: _Evidence) -> str:
    if evidence.effort[joint.index] >= 0.999 * joint.effort:
        limit = f"{joint.effort:g} {_unit(joint, 'N·m', 'N')}"
        return f"; its motor was at its limit of {limit}: too weak, or is something in its way?"
    return "; is something in its way?"


def _pushed(joint: TestedJoint, trial: Trial, state: Signal) -> Iterator[str]:
    """Say whether a push forward moves it further forward than one back, and what was applied."""
    forward, back = trial.pushes
    position = state.fields["position"][:, joint.index]
    if not position[forward] > position[back]:
        yield "a positive torque does not move it forward"
    effort = state.of("effort", joint.name)
    for place, torque in ((forward, joint.push), (back, -joint.push)):
        if effort is not None and not math.isclose(effort[place], torque, rel_tol=1e-3):
            unit = _unit(joint, "N·m", "N")
            yield f"applies {effort[place]:.3g} {unit} where {torque:.3g} are commanded"


def _moved_most(
    joint: TestedJoint, joints: Sequence[TestedJoint], evidence: _Evidence
) -> tuple[str, float] | None:
    """Return which of the joints that are held moved most, and how far."""
    others = [j for j in joints if j is not joint and j.effort > 0]
    held = [j for j in others if j.mode in ("position", "velocity")]
    moved = [(j.name, float(abs(evidence.after[j.index] - evidence.before[j.index]))) for j in held]
    return max(moved, key=lambda row: row[1], default=None)


def _others(
    others: tuple[str, float] | None, joints: Sequence[TestedJoint], evidence: _Evidence
) -> Iterator[str]:
    if others is None:
        return
    other = next(joint for joint in joints if joint.name == others[0])
    if others[1] > _STILL[other.is_rotary]:
        tail = ""
        if evidence.effort[other.index] >= 0.999 * other.effort:
            limit = f"{other.effort:g} {_unit(other, 'N·m', 'N')}"
            tail = f", whose motor was at its limit of {limit}: does something push it?"
        yield f"moves {other.name} as well, by {_amount(other, others[1])}{tail}"


def _limits(joint: TestedJoint, evidence: _Evidence, *, free: bool) -> Iterator[str]:
    margin = (_FALLEN if free else _CLOSE)[joint.is_rotary]
    end = float(evidence.after[joint.index])
    if not joint.lower - margin <= end <= joint.upper + margin:
        yield f"is at {end:.4f}, beyond its stops [{joint.lower:g}, {joint.upper:g}]"
    speed, effort = evidence.speed[joint.index], evidence.effort[joint.index]
    if not free and speed > 1.1 * joint.speed:
        unit = _unit(joint, "rad/s", "m/s")
        yield f"moves at {speed:.2f} {unit}, beyond its limit of {joint.speed:g}"
    if effort > 1.001 * joint.effort:
        yield f"applies {effort:.3g}, beyond its limit of {joint.effort:g}"


def _amount(joint: TestedJoint, value: float) -> str:
    return f"{math.degrees(value):.2f}°" if joint.is_rotary else f"{1e3 * value:.2f} mm"


def _unit(joint: TestedJoint, rotary: str, prismatic: str) -> str:
    return rotary if joint.is_rotary else prismatic
