"""The ports and the settings of a controller of a mobile manipulator."""

from dataclasses import replace

from stepbus_kinematics import RobotModel, SelfCollisions
from stepbus_participant import Config, Ports, Problems, suggest
from stepbus_store.motion.back_to_rest import StowCondition
from stepbus_store.motion.manipulator.options import ManipulatorOptions
from stepbus_store.motion.manipulator.settings import make_limits, make_robot
from stepbus_store.motion.mobile.params import Params
from stepbus_store.motion.sensed import MonitorSettings


class MobilePorts:
    """Names of the ports, found by their types; some scenarios leave out those that may be None.

    Problems are added to `ports`.
    """

    def __init__(self, ports: Ports) -> None:
        self.plan = ports.optional_input_of("Plan/1")
        self.plan_request = ports.optional_output_of("PlanRequest/1")
        if (self.plan is None) != (self.plan_request is None):
            text = "a planner needs an input of type Plan/1 and an output of type PlanRequest/1"
            ports.problems.add((), f"{text}; connect both or neither")
        self.joint_state = ports.input_of("JointState/1")
        self.odometry = ports.input_of("BaseState/1")
        self.gripper_state = ports.input_of("GripperState/1")
        self.goal = ports.input_of("Goal/1")
        self.contacts = ports.optional_input_of("Contacts/1")
        self.stop = ports.optional_input_of("EmergencyStop/1")
        self.arm = ports.output_of("JointCommand/1")
        self.base = ports.output_of("BaseCommand/1")
        self.gripper = ports.output_of("GripperCommand/1")
        self.goal_status = ports.output_of("GoalStatus/1")
        self.status = ports.optional_output_of("ControllerStatus/1")
        ports.outputs_are(
            "JointCommand/1", "BaseCommand/1", "GripperCommand/1", "GoalStatus/1", "PlanRequest/1",
            "ControllerStatus/1",
        )  # fmt: skip


_PLANNED_JERK = 0.9
"""Share of the jerk limit that a motion uses: slowed down near things, it has 1.1 times as much."""


class MobileSettings:
    """The ports, parameters, model and settings of a `MobileController`.

    Raises SettingsError with all that is wrong.
    """

    def __init__(self, config: Config) -> None:
        ports = Ports(config)
        self.ports = MobilePorts(ports)
        self.params = params = config.read(Params, ports.problems)
        problems = config.problems().below(("params",))
        self.robot = robot = make_robot(params, problems, params.posture)
        monitor = _monitor(params, robot, problems)
        self.monitor = monitor if self.ports.contacts is not None else None
        self.collisions: SelfCollisions | None = None
        srdf, margin = params.srdf, params.collision_margin
        if srdf is not None:
            self.collisions = problems.attempt(
                ("srdf",), lambda: SelfCollisions(robot, srdf, margin)
            )
        problems.refuse()
        limits = make_limits(params, robot, params.acceleration_limit, params.jerk_limit)
        self.limits = replace(limits, jerk=_PLANNED_JERK * limits.jerk)
        self.arm = ManipulatorOptions(
            period=config.every * config.step_ns * 1e-9,
            tip=params.tip,
            tip_velocity=params.tip_velocity,
            tip_acceleration=params.tip_acceleration,
            tip_jerk=params.tip_jerk,
            plan_timeout=params.plan_timeout,
            jam_lag=params.arm_lag,
        )
        self.stow = StowCondition(
            robot=robot, frame=params.tip, height=params.safe_height, reach=params.safe_reach
        )


def _monitor(params: Params, robot: RobotModel, problems: Problems) -> MonitorSettings:
    links = robot.links
    wheels = tuple(name for name in links if "wheel" in name or "caster" in name)
    ignore = wheels if params.ignore is None else params.ignore
    for key, names in (("tip", (params.tip,)), ("pads", params.pads), ("ignore", ignore)):
        for name in names:
            if name not in links:
                problems.add((key,), f"link {name!r} is not in the model{suggest(name, links)}")
    if params.tip in links and not robot.chain(params.tip).size:
        problems.add(("tip",), f"no joint of this controller moves {params.tip!r}")
    return MonitorSettings(
        params=params,
        links=frozenset(links),
        base_links=frozenset(name for name in links if not robot.chain(name).size),
        ignore=frozenset(ignore),
    )
