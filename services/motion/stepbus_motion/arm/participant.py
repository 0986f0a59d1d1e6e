"""A controller that carries out goals: `python -m stepbus_motion.arm`."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version

import numpy as np

from stepbus_kinematics import JointOrder, Vector, delay_warning
from stepbus_motion.goals.runner import GoalRunner
from stepbus_motion.ik.search import IkSettings, InverseKinematics
from stepbus_motion.manipulator.detours import Planner
from stepbus_motion.paths.motion import MotionLimits
from stepbus_participant import Config, Participant, Step
from stepbus_participant.settings import Settings
from stepbus_schemas import (
    ControllerStatus,
    Description,
    Goal,
    JointCommand,
    JointState,
    Message,
    RunError,
    WiringError,
)

from .settings import ArmSettings, read_arm_settings


class ArmController(Participant):
    """Brings joints or frames of a robot to where the newest goal wants them.

    Inputs: one JointState/1 and one Goal/1. Outputs: one JointCommand/1 of mode position with
    feed-forward velocity at every step; one GoalStatus/1 whenever there is news; where the
    scenario wires them, one ControllerStatus/1, and one JointState/1 with the measurements as
    they are after smoothing. A goal is taken in when its id differs from the one before.

    The effort limits that a pose is judged by are those that the plant describes. Parameters: see
    `read_arm_settings`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        settings = Settings(config)
        self._state_port = settings.input_of("JointState/1")
        self._goal_port = settings.input_of("Goal/1")
        self._command_port = settings.output_of("JointCommand/1")
        self._goal_status_port = settings.output_of("GoalStatus/1")
        self._status_port = settings.optional_output_of("ControllerStatus/1")
        self._smoothed_port = settings.optional_output_of("JointState/1")
        settings.outputs_are("JointCommand/1", "GoalStatus/1", "ControllerStatus/1", "JointState/1")
        self._period = config.every * config.step_ns * 1e-9
        self._arm: ArmSettings = read_arm_settings(settings, self._period)
        self._q: Vector | None = None
        self._goal_id = -1

    def describe(self) -> Mapping[str, Description]:
        """Return the joints in the order of the commands, and what smoothing costs."""
        names = list(self._arm.robot.joints)
        described = {self._command_port: Description(names=names)}
        if self._status_port is not None:
            described[self._status_port] = Description(names=names)
        if self._smoothed_port is not None:
            delay = [f"{self._delay * 1e3:.1f} ms"] * len(names)
            described[self._smoothed_port] = Description(names=names, details={"delay": delay})
        return described

    @property
    def _delay(self) -> float:
        """Return by how much the measurements come late [s]."""
        return self._arm.smoother.delay if self._arm.smoother is not None else 0.0

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map the joints by name and take the plant's effort limits.

        Raises WiringError for joints that the plant does not sense.
        """
        arm, described = self._arm, inputs[self._state_port]
        try:
            self._order = JointOrder(self._state_port, described.names, arm.robot.joints)
        except WiringError as exc:
            lines = [f"{self.config.name}: {line}" for line in str(exc).splitlines()]
            raise WiringError("\n".join(lines)) from exc
        effort = described.limits.get("effort")
        if effort is not None:
            arm.robot.effort_limit = self._order.pick(effort, "effort limits")
        self._runner = make_runner(arm, self.config.seed)

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the targets of this step, and what is new of the goal."""
        self._sense(step)
        if self._q is None:
            return {}
        goal = step.get(self._goal_port, Goal)
        if goal is not None and goal.id != self._goal_id:
            self._goal_id = goal.id
            self._runner.begin(goal, step.t)
        messages: dict[str, Message] = {self._command_port: self._command(step.t)}
        news = self._runner.news()
        if news is not None:
            messages[self._goal_status_port] = news
        return messages | self._extras(step)

    def _sense(self, step: Step) -> None:
        if not step.is_new(self._state_port):
            return
        state = step.read(self._state_port, JointState)
        q = self._order.pick(state.position, "position")
        if self._arm.smoother is not None:
            q = self._arm.smoother.update(q)
        if self._q is None:
            self._runner.hold(q)
            self._v = np.zeros_like(q)
        elif self._arm.smoother is not None or state.velocity is None:
            self._v = (q - self._q) / self._period
        else:
            self._v = self._order.pick(state.velocity, "velocity")
        self._q = q
        self._runner.look(q, self._v, step.t)

    def _command(self, t: float) -> JointCommand:
        """Return where the joints shall be, and how fast they get to where they shall be next."""
        robot = self._arm.robot
        # A motion that ends at a stop may be beyond it by the rounding of its polynomials.
        now, then = (
            np.clip(self._runner.at(at).position, robot.lower, robot.upper)
            for at in (t, t + self._period)
        )
        velocity = (then - now) / self._period
        return JointCommand(mode="position", values=now.tolist(), velocity=velocity.tolist())

    def _extras(self, step: Step) -> dict[str, Message]:
        if self._q is None:
            raise RunError(f"{self.config.name}: step {step.index}: nothing was measured yet")
        extras: dict[str, Message] = {}
        if self._status_port is not None:
            error: list[float] = (self._runner.at(step.t).position - self._q).tolist()
            warnings = delay_warning(self._arm.smoother) if step.index == 0 else []
            extras[self._status_port] = ControllerStatus(
                error=error, saturated=[False] * len(error), warnings=warnings
            )
        if self._smoothed_port is not None:
            extras[self._smoothed_port] = JointState(
                position=self._q.tolist(), velocity=self._v.tolist()
            )
        return extras

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the motion."""
        return {name: version(name) for name in ("numpy", "pin", "coal", "ruckig")}


def make_runner(arm: ArmSettings, seed: int) -> GoalRunner:
    """Return what carries out goals; seed: of all that is drawn at random."""
    robot, collisions = arm.robot, arm.collisions
    limits = MotionLimits(
        velocity=np.array(arm.velocity),
        acceleration=np.array(arm.acceleration),
        jerk=np.array(arm.jerk),
    )
    ik = InverseKinematics(robot, IkSettings(), seed=seed, collisions=collisions)
    planner = Planner(robot, limits, seed=seed, collisions=collisions)
    return GoalRunner(
        robot, ik, planner, limits, arm.settling, tries_unholdable=arm.tries_unholdable
    )
