"""What a planner works with: its robot, and the limits of its plans."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from stepbus_participant import Config, Problems
from stepbus_schemas import WiringError

from .base.curve import BasePace
from .params import Params
from .paths.planning import PlanningSettings
from .paths.timing import Limits
from .scene.robot import PlannedRobot
from .scene.scene import Margins

_EFFORT_SHARE = 0.8
"""Of the URDF's effort limits; the rest is for following the plan."""

_LONGEST_SAMPLE_NS = 20_000_000


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What the parameters describe.

    prefix: what the plant puts before the robot's names. frame: link that identifies the robot
    among the poses. latency_ns: of an answer [ns];
    check_latency_ns: where a path is only checked. base_radius: that a base needs to turn,
    base_half_width: that it needs to drive straight [m]. base_pace: how fast it is.
    """

    robot: PlannedRobot
    planning: PlanningSettings
    prefix: str
    frame: str
    latency_ns: int
    check_latency_ns: int
    base_radius: float
    base_half_width: float
    base_pace: BasePace


def read_setup(config: Config, problems: Problems) -> Setup:
    """Return what the scenario's params describe.

    problems: of the ports. Raises SettingsError with all that is wrong.
    """
    params = config.read(Params, problems)
    robot = _make_robot(params, config.problems().below(("params",)))
    limits = Limits(
        velocity=np.minimum(params.velocity_limit.of(robot.joints), robot.velocity_limit),
        acceleration=np.array(params.acceleration_limit.of(robot.joints)),
        jerk=np.array(params.jerk_limit.of(robot.joints)),
        effort=_EFFORT_SHARE * robot.effort_limit,
    )
    planning = PlanningSettings(
        tip=params.tip,
        margins=Margins(robot=params.margin, held=params.held_margin, path=params.path_margin),
        limits=limits,
        max_checks=params.max_checks,
        period=_sample_period(config.every * config.step_ns),
    )
    return Setup(
        robot=robot,
        planning=planning,
        prefix=params.prefix,
        frame=params.prefix + params.frame,
        latency_ns=params.latency_ns,
        check_latency_ns=params.check_latency_ns,
        base_radius=params.base_radius,
        base_half_width=params.base_half_width,
        base_pace=BasePace(
            speed=params.base_speed,
            acceleration=params.base_acceleration,
            turn_speed=params.base_turn_speed,
            turn_acceleration=params.base_turn_acceleration,
        ),
    )


def _sample_period(period_ns: int) -> float:
    """Return the distance of the samples of a plan [s]: whole steps, if they are below 20 ms."""
    return max(_LONGEST_SAMPLE_NS // period_ns, 1) * min(period_ns, _LONGEST_SAMPLE_NS) * 1e-9


def _make_robot(params: Params, problems: Problems) -> PlannedRobot:
    links = {"frame": params.frame, "tip": params.tip}
    make = partial(PlannedRobot, params.model, params.joints, params.posture, params.srdf)
    try:
        return make(list(links.values()))
    except WiringError as exc:
        for problem in str(exc).splitlines():
            named = (param for param, link in links.items() if f"link {link!r} " in problem)
            problems.add((next(named, "model"),), problem)
        raise problems.error() from exc
