"""From the parameters of the controller of an arm to what it works with."""

from dataclasses import dataclass

from stepbus_kinematics import RobotModel, SelfCollisions, Smoother, make_smoother
from stepbus_participant import Config, Problems
from stepbus_store.motion.manipulator.settings import make_limits, make_robot, make_settling
from stepbus_store.motion.manipulator.settling import Settling
from stepbus_store.motion.motions.joint_motion import MotionLimits

from .params import Params


@dataclass(frozen=True, kw_only=True)
class ArmSettings:
    """What an `ArmController` works with; limits: of the joints."""

    robot: RobotModel
    collisions: SelfCollisions | None
    limits: MotionLimits
    settling: Settling
    tries_unholdable: bool
    prefix: str
    smoother: Smoother | None


def read_arm_settings(config: Config, problems: Problems, period: float) -> ArmSettings:
    """Return what the scenario's params describe.

    problems: of the ports. period: between two measurements [s]. Raises SettingsError with all that
    is wrong.
    """
    params = config.read(Params, problems)
    found = config.problems().below(("params",))
    robot = make_robot(params, found)
    collisions, srdf = None, params.srdf
    if srdf is not None:
        margin = params.collision_margin
        collisions = found.attempt(("srdf",), lambda: SelfCollisions(robot, srdf, margin))
    found.refuse()
    return ArmSettings(
        robot=robot,
        collisions=collisions,
        limits=make_limits(params, robot, params.acceleration_limit, params.jerk_limit),
        settling=make_settling(params),
        tries_unholdable=params.not_holdable == "try",
        prefix=params.prefix,
        smoother=make_smoother(params.smoothing, params.time_constant, params.window, period),
    )
