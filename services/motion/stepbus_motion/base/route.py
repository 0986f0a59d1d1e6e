"""From a goal of the base to segments."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from msgspec.structs import replace

from stepbus_motion.outcome import FARTHEST, Refused
from stepbus_schemas import BaseState, Goal

from .segments import PlannedSegment, straight, straight_to, turn_by, turn_to, wrapped


@dataclass(frozen=True, kw_only=True)
class BaseRoute:
    """The segments of a goal.

    target: pose to stand at, x, y, yaw [m, rad]; None: wherever the last segment ends.
    """

    segments: deque[PlannedSegment]
    text: str
    target: tuple[float, float, float] | None = None


def base_route(
    goal: Goal, state: BaseState, position: float, via: Sequence[tuple[float, float]] = ()
) -> BaseRoute:
    """Return the segments that a goal needs from the base's state.

    via: points on the way to the pose of a go_to [m]. position: closer to its target than twice
    that, the base only turns [m]. Raises Refused for a goal that makes no sense.
    """
    if goal.type == "drive":
        _refuse_odd("by", goal.by)
        return BaseRoute(segments=deque([straight(goal.by)]), text=f"drive {goal.by:.3f} m")
    if goal.type == "turn":
        _refuse_odd("by", goal.by)
        text = f"turn by {math.degrees(goal.by):.1f}°"
        return BaseRoute(segments=deque([turn_by(goal.by)]), text=text)
    if goal.type != "go_to" or goal.base is None:
        raise Refused("invalid", f"type {goal.type} needs base: x, y, yaw")
    for name, value in zip(("x", "y", "yaw"), goal.base, strict=True):
        _refuse_odd(name, value)
    return _route_by(via, goal.base, state, position)


def _route_by(
    via: Sequence[tuple[float, float]],
    target: tuple[float, float, float],
    state: BaseState,
    position: float,
) -> BaseRoute:
    segments: deque[PlannedSegment] = deque()
    now = state
    for n, (x, y) in enumerate(via):
        after = via[n + 1] if n + 1 < len(via) else target[:2]
        ahead = math.atan2(y - now.y, x - now.x)
        following = math.atan2(after[1] - y, after[0] - x)
        back = min(_turning(now, following + flip, ahead + math.pi) for flip in (0, math.pi)) < (
            min(_turning(now, following + flip, ahead) for flip in (0, math.pi)) - 1e-9
        )
        heading = ahead + math.pi if back else ahead
        segments += [turn_to(heading), straight_to(x, y, back=back)]
        now = replace(now, x=x, y=y, yaw=heading)
    rest = _route_to(target, now, position)
    return BaseRoute(segments=segments + rest.segments, text=rest.text, target=target)


def _route_to(target: tuple[float, float, float], state: BaseState, position: float) -> BaseRoute:
    x, y, yaw = target
    length = math.hypot(x - state.x, y - state.y)
    text = f"go {length:.3f} m to x {x:.3f} m, y {y:.3f} m, yaw {math.degrees(yaw):.1f}°"
    last = turn_to(yaw)
    if length <= 2 * position:
        return BaseRoute(segments=deque([last]), text=text, target=target)
    ahead = math.atan2(y - state.y, x - state.x)
    back = _turning(state, yaw, ahead + math.pi) < _turning(state, yaw, ahead) - 1e-9
    first = turn_to(ahead + math.pi if back else ahead)
    segments = deque([first, straight_to(x, y, back=back), last])
    return BaseRoute(segments=segments, text=text, target=target)


def _turning(state: BaseState, last: float, heading: float) -> float:
    """Return how much the base turns in all to drive at a heading and end at `last` [rad]."""
    return abs(wrapped(heading - state.yaw)) + abs(wrapped(last - heading))


def _refuse_odd(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise Refused("invalid", f"{name} is {value}, not a finite number")
    if abs(value) > FARTHEST:
        raise Refused("invalid", f"{name} is {value:g}; more than {FARTHEST:g} m or rad is too far")
