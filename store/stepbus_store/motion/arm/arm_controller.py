"""Carries out goals of an arm without a base."""

from collections.abc import Mapping

from stepbus_participant import Config, Ports, Step, installed_version
from stepbus_schemas import Description, Goal, JointState, Message
from stepbus_store.memory import Remembering
from stepbus_store.motion.arm.params import Params
from stepbus_store.motion.executor import GoalExecutor
from stepbus_store.motion.joint_motion import ManipulatorOptions
from stepbus_store.motion.manipulator import Manipulator
from stepbus_store.motion.manipulator_setup import make_collisions, make_limits, make_robot
from stepbus_store.motion.outcome import JointSensor, Measured
from stepbus_store.motion.parts import Parts


class ArmController(Remembering):
    """Moves the joints or frames of a robot to the newest goal.

    Inputs: one JointState/1 and one Goal/1. Outputs: one JointCommand/1 of mode position with
    feed-forward velocity at every step; one GoalStatus/1 whenever the status changes; optionally,
    one ControllerStatus/1. A goal starts when its id differs from the previous one.

    The plant's effort limits decide whether a pose can be held. Parameters: see `Params`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._state_port = ports.input_of("JointState/1")
        self._goal_port = ports.input_of("Goal/1")
        self._command_port = ports.output_of("JointCommand/1")
        self._goal_status_port = ports.output_of("GoalStatus/1")
        self._status_port = ports.optional_output_of("ControllerStatus/1")
        ports.outputs_are("JointCommand/1", "GoalStatus/1", "ControllerStatus/1")
        self._period = config.every * config.step_ns * 1e-9
        params = self._params = config.read(Params, ports.problems)
        problems = config.problems().below(("params",))
        self._robot = make_robot(params, problems)
        srdf, margin = params.srdf, params.collision_margin
        self._collisions = make_collisions(self._robot, srdf, margin, problems)
        problems.refuse()
        self._now: Measured | None = None

    def describe(self) -> Mapping[str, Description]:
        """Return the joints in the order of the commands."""
        names = [self._params.prefix + joint for joint in self._robot.joints]
        ports = (self._command_port, self._status_port)
        return {port: Description(names=names) for port in ports if port is not None}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Put the arm together; raises WiringError for joints that the plant does not sense."""
        params, robot, port = self._params, self._robot, self._state_port
        self._sensor = JointSensor(
            port, inputs[port], robot, period=self._period, prefix=params.prefix
        )
        self._manipulator = Manipulator(
            robot,
            make_limits(params, robot, params.acceleration_limit, params.jerk_limit),
            params,
            # It stops within the limits of its motions.
            ManipulatorOptions(
                period=self._period, tip="", effort_share=1.0, brake_acceleration=0, brake_jerk=0
            ),
            seed=self.config.seed,
            collisions=self._collisions,
            tries_unholdable=params.not_holdable == "try",
        )
        self._executor = GoalExecutor(Parts(arm=self._manipulator))
        self.remember()

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the targets of this step, and what is new about the goal."""
        if step.is_new(self._state_port):
            now = self._sensor.read(step.read(self._state_port, JointState))
            if self._now is None:
                self._executor.hold(now)
            self._now = now
            self._executor.check(now, step.t, self._period)
        if self._now is None:
            return {}
        self._executor.start(step.get(self._goal_port, Goal), step.t)
        target = self._manipulator.at(step.t)
        messages: dict[str, Message] = {self._command_port: target.command()}
        status = self._executor.reports.next_status()
        if status is not None:
            messages[self._goal_status_port] = status
        if self._status_port is not None:
            error = target.position - self._now.q
            messages[self._status_port] = self._executor.reports.controller_status(error)
        return messages

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the motion."""
        return {name: installed_version(name) for name in ("numpy", "pin", "coal", "ruckig")}
