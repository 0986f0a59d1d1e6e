"""What no robot can avoid: something is put into it, or nearer than it can brake."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from .log import Row, SaleLog

STEP_S = 0.016
REACTION_S = 0.016
"""What is measured in a step has an effect in the next one."""

BASE_BRAKE = 5.0
"""With locked wheels the base slides to rest like that: from 0.6 m/s in 0.12 s [m/s²]."""

ARM_BRAKE = 10.0
"""About what the motors give a link of the arm [m/s²]."""

_BASE = ("chassis", "left_wheel_link", "right_wheel_link", "front_caster", "back_caster")
_REACH = 0.45
"""Of the base from the axis of its turns [m]."""

_FOR_STEPS = 63
"""How long after it has appeared something may be hit for that: 1 s."""


@dataclass
class Excuses:
    """What is no participant's fault.

    overlaps: the step from which on something is inside the robot, after which no force says
    anything; None: never. hits: pair of links → steps until which it may be hit, with sentences.
    """

    overlaps: int | None = None
    hits: dict[frozenset[str], list[range]] = field(default_factory=dict)
    texts: list[str] = field(default_factory=list)

    def covers(self, pair: Sequence[str], step: int) -> bool:
        """Return whether a force between two links at a step could not be avoided."""
        if self.overlaps is not None and step >= self.overlaps:
            return True
        return any(step in steps for steps in self.hits.get(frozenset(pair), ()))


def excuses(log: SaleLog, script: Sequence[Mapping[str, Any]]) -> Excuses:
    """Return what a robot could not avoid; script: actions of the plant."""
    excused = Excuses()
    contacts = log.messages.get("plant/contacts", [])
    ours = set(log.names.get("plant/contacts", ()))
    for action in script:
        if "body" in action and str(action["body"]) in log.bodies.values():
            at = math.ceil(float(str(action["at"]).removesuffix("s")) / STEP_S - 1e-6)
            # Put there at the beginning of a step, it is measured at the end of that.
            row = next((row for row in contacts if row[0] > at), None)
            if row is not None:
                _add(excused, log, ours, str(action["body"]), row)
    return excused


def _add(excused: Excuses, log: SaleLog, ours: set[str], body: str, row: Row) -> None:
    """Compare the gaps between the robot and a body that has just appeared with the bound."""
    step, contacts = row
    for pair, gap in zip(contacts["pairs"], contacts["distance"], strict=True):
        mine = [link for link in pair if link in ours]
        others = [link for link in pair if log.bodies.get(link) == body]
        if len(mine) != 1 or len(others) != 1:
            continue
        speed = _speed(log, mine[0], step)
        brake = BASE_BRAKE if mine[0] in _BASE else ARM_BRAKE
        # How far it goes until it stands.
        bound = speed * REACTION_S + speed**2 / (2.0 * brake)
        if gap <= 0.0:
            excused.overlaps = step if excused.overlaps is None else min(excused.overlaps, step)
            excused.texts.append(f"{others[0]} was put into {mine[0]} at step {step}")
        elif gap < bound:
            # The body of the base is one thing: what one of its links comes near, another may hit.
            links = _BASE if mine[0] in _BASE else mine
            for link in links:
                steps = range(step, step + _FOR_STEPS)
                excused.hits.setdefault(frozenset((link, others[0])), []).append(steps)
            excused.texts.append(
                f"{others[0]} appeared {gap * 1e3:.0f} mm from {mine[0]}, which needed "
                f"{bound * 1e3:.0f} mm to stop from {speed:.2f} m/s"
            )


def _speed(log: SaleLog, link: str, step: int) -> float:
    """Return the speed of a link before a step [m/s]."""
    if link in _BASE:
        rows = [row for at, row in log.messages.get("plant/odometry", ()) if at < step]
        return abs(rows[-1]["vx"]) + _REACH * abs(rows[-1]["wz"]) if rows else 0.0
    names = log.names.get("plant/poses", [])
    return max((_moved(log, names.index(name), step) for name in _with_tip(link, names)), default=0)


def _with_tip(link: str, names: Sequence[str]) -> Iterator[str]:
    """Yield a link and the next one, whose frame is at its end."""
    if link in names:
        place = names.index(link)
        yield from names[place : place + 2]


def _moved(log: SaleLog, index: int, step: int) -> float:
    """Return the speed of a link's frame over the last two poses before a step [m/s]."""
    rows = [(at, row["position"][index]) for at, row in log.messages["plant/poses"] if at <= step]
    if len(rows) < 2:
        return 0.0
    (a, one), (b, other) = rows[-2:]
    return math.dist(one, other) / ((b - a) * STEP_S)
