"""What a scenario says about a planner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stepbus_participant import parse_duration
from stepbus_participant.settings import Settings
from stepbus_schemas import WiringError

from .planning import PlanningSettings
from .robot import PlannedRobot
from .scene import Margins
from .timing import Limits

_EFFORT_SHARE = 0.8
"""Of the URDF's effort limits; the rest is for following the plan."""


@dataclass(frozen=True, kw_only=True)
class Params:
    """The parameters of a planner; frame: link that says which body of the world is the robot.

    latency_ns: from a request to its answer, at least [ns].
    """

    robot: PlannedRobot
    planning: PlanningSettings
    frame: str
    latency_ns: int


def read_params(settings: Settings) -> Params:
    """Return what the scenario's params say; see `PlannerParticipant`.

    Raises WiringError with all that is wrong.
    """
    frame = str(settings.value("frame", "chassis"))
    tip = str(settings.value("tip", "grasp"))
    robot = _read_robot(settings, {"frame": frame, "tip": tip})
    velocity = _read_limit(settings, robot, "velocity_limit", 1.5)
    acceleration = _read_limit(settings, robot, "acceleration_limit", 3.0)
    margins = Margins(
        robot=settings.number("margin", 0.01, bound="not negative"),
        held=settings.number("held_margin", 0.003, bound="not negative"),
    )
    max_checks = settings.number("max_checks", 20_000, bound="positive")
    latency_ns = _read_latency(settings)
    settings.check()
    if robot is None:
        settings.refuse()
    limits = Limits(
        velocity=np.minimum(velocity, robot.velocity_limit),
        acceleration=np.array(acceleration),
        effort=_EFFORT_SHARE * robot.effort_limit,
    )
    planning = PlanningSettings(tip=tip, margins=margins, limits=limits, max_checks=int(max_checks))
    return Params(robot=robot, planning=planning, frame=frame, latency_ns=latency_ns)


def _read_robot(settings: Settings, links: Mapping[str, str]) -> PlannedRobot | None:
    path, joints = settings.file("model"), settings.names("joints")
    settings.value("srdf", "")
    srdf = settings.file("srdf") if settings.has("srdf") else None
    posture = settings.value("posture", {})
    if not isinstance(posture, dict):
        settings.note("posture", f"is {posture!r}, not a map from joints to positions")
        posture = {}
    still = {name: settings.as_number(f"posture.{name}", at) for name, at in posture.items()}
    if path is None or not joints:
        return None
    try:
        return PlannedRobot(path, joints, still, srdf, list(links.values()))
    except WiringError as exc:
        for problem in str(exc).splitlines():
            named = (param for param, link in links.items() if f"link {link!r} " in problem)
            settings.note(next(named, "model"), problem)
        return None


def _read_limit(
    settings: Settings, robot: PlannedRobot | None, param: str, default: float
) -> list[float]:
    """Return a limit of each joint; of a robot that cannot be read, nothing can be said."""
    if robot is None:
        settings.value(param, default)
        return []
    return settings.per_name(param, robot.joints, default, bound="positive")


def _read_latency(settings: Settings) -> int:
    text = settings.value("latency", "200ms")
    try:
        return parse_duration(str(text))
    except WiringError as exc:
        settings.note("latency", str(exc))
        return 0
