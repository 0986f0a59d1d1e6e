"""What a scenario says about a planner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepbus.durations import parse_duration
from stepbus.settings import Settings
from stepbus_schemas import WiringError

from .planning import Task
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
    task: Task
    frame: str
    latency_ns: int


def read_params(settings: Settings) -> Params:
    """Return what the scenario's params say; see `PlannerParticipant`.

    Raises WiringError with all that is wrong.
    """
    robot = _read_robot(settings)
    joints = robot.joints if robot is not None else ()
    frame = _read_frame(settings, robot, "frame", "chassis")
    tip = _read_frame(settings, robot, "tip", "grasp")
    velocity = settings.per_name("velocity_limit", joints, 1.5, bound="positive")
    acceleration = settings.per_name("acceleration_limit", joints, 3.0, bound="positive")
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
    task = Task(tip=tip, margins=margins, limits=limits, max_checks=int(max_checks))
    return Params(robot=robot, task=task, frame=frame, latency_ns=latency_ns)


def _read_robot(settings: Settings) -> PlannedRobot | None:
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
        return PlannedRobot(path, joints, still, srdf)
    except WiringError as exc:
        for problem in str(exc).splitlines():
            settings.note("model", problem)
        return None


def _read_frame(settings: Settings, robot: PlannedRobot | None, param: str, default: str) -> str:
    name = str(settings.value(param, default))
    if robot is not None:
        try:
            robot.frame_id(name)
        except WiringError as exc:
            settings.note(param, str(exc))
    return name


def _read_latency(settings: Settings) -> int:
    text = settings.value("latency", "200ms")
    try:
        return parse_duration(str(text))
    except WiringError as exc:
        settings.note("latency", str(exc))
        return 0
