"""A mission that picks up a cube with a SCARA arm and puts it down at a goal."""

import math
from collections.abc import Mapping
from typing import Annotated

import msgspec

from stepbus_participant import (
    Config,
    ModelFile,
    Names,
    Participant,
    Ports,
    Positive,
    Settings,
    Step,
    Text,
    Vector3,
    suggest,
)
from stepbus_scenarios.pick.picking import (
    CARRIES,
    CLOSED,
    MOVES,
    NEXT,
    Motion,
    Stage,
    Waypoint,
    distance,
    motion,
    plan,
    spot_of,
    turn,
)
from stepbus_scenarios.pick.scara import Scara, Spot
from stepbus_schemas import (
    Description,
    Event,
    GripperCommand,
    GripperState,
    JointCommand,
    Message,
    Poses,
    RunError,
    SensedJoints,
    WiringError,
)

_SURE = 0.1
"""For so long the gripper says that it holds the cube before it is lifted [s]."""

_LOST = 0.2
"""For so long the gripper says that it holds nothing before the cube counts as lost [s]."""

_OPEN = 2e-3
"""The gripper is open when it lacks less than this [m]."""

_SETTLE = 0.3
"""From the end of the last motion until the cube is measured [s]."""


class Params(Settings):
    """Parameters of `stepbus_scenarios.pick.mission`."""

    model: ModelFile
    """URDF of the arm: two links in a horizontal plane, a lift and a wrist, all axes vertical."""
    joints: Names
    """Joints of the arm: shoulder, elbow, lift and wrist."""
    prefix: str = ""
    """Prefix of this robot's joint and link names in the plant, such as `left/` if two bodies
    from one URDF share a world."""
    base: Text
    """Link of the upright arm base; the goal is given in its frame."""
    tip: Text
    """Link between the pads, which open along its y axis."""
    cube: Text
    """Link of the cube; its origin is the centre of the bottom face."""
    goal: Vector3
    """Goal of the cube: x, y, yaw [m, m, rad]; any quarter turn counts."""
    grip_height: Positive = 0.025
    """Height of the tip above the bottom of the cube when it grips [m]."""
    clearance: Positive = 0.1
    """Height by which the cube is lifted [m]."""
    opening: Positive = 0.08
    """Width of the open gripper [m]."""
    force: Positive = 10.0
    """Grip force of each finger [N]."""
    speed: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.8
    """Fraction of the joints' velocity limits that motions use [-]."""
    patience: Positive = 2.0
    """Longest time for the gripper to grip, and to open [s]."""
    tolerance: Positive = 0.005
    """Largest distance from the goal at which the cube counts as placed [m]."""


class _Progress(msgspec.Struct, forbid_unknown_fields=True):
    """How far a pick is; it is the state of the mission at a checkpoint.

    waypoints: joint positions, shape (4,). height: of the bottom of the cube [m]. motion: the
    latest one. since_ns: when the stage began. holds: what the gripper says, and since when [ns].
    is_concluded: whether the result is known. failure: why the pick has failed; empty: it has not.
    """

    waypoints: dict[Waypoint, tuple[float, ...]]
    height: float
    motion: Motion
    since_ns: int = 0
    stage: Stage = "reach"
    holds: bool = False
    holds_since_ns: int = 0
    is_concluded: bool = False
    failure: str = ""


class Pick(Participant):
    """Picks up a cube and puts it down at a goal, then ends the run.

    Inputs: one Poses/1 with the base of the arm and the cube, one JointState/1 and one
    GripperState/1. Outputs: one JointCommand/1 in mode position, one GripperCommand/1, and an
    Event/1 for each stage; an output of type Event/1 named `summary` reports the final distance of
    the cube from its goal. Raises RunError if the cube is out of reach, not gripped, lost or
    misplaced. Parameters: see `Params`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._poses_port = ports.input_of("Poses/1")
        self._state_port = ports.input_of("JointState/1")
        self._sensor_port = ports.input_of("GripperState/1")
        self._command_port = ports.output_of("JointCommand/1")
        self._gripper_port = ports.output_of("GripperCommand/1")
        self._event_port, self._summary_port = ports.event_outputs()
        ports.outputs_are("JointCommand/1", "GripperCommand/1", "Event/1")
        params = self._params = config.read(Params, ports.problems)
        problems = config.problems()
        arm = problems.attempt(
            ("params", "model"),
            lambda: Scara.read(params.model, params.joints, params.base, params.tip),
        )
        if arm is None:
            raise problems.error()
        self._arm = arm
        self._joints = [params.prefix + joint for joint in params.joints]
        self._period_ns = config.every * config.step_ns
        self._progress: _Progress | None = None

    def describe(self) -> Mapping[str, Description]:
        """Return the joints in the order of the commands."""
        rest = dict.fromkeys(self.config.outputs, Description())
        return {**rest, self._command_port: Description(names=self._joints)}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Find joints and links among those that the plant measures.

        Raises WiringError for what it does not.
        """
        params = self._params
        links = [params.prefix + params.base, params.cube]
        wanted = {self._poses_port: ("link", links), self._state_port: ("joint", self._joints)}
        missing = [
            f"{self.config.name}: input {port!r} has no {kind} {name!r}"
            f"{suggest(name, inputs[port].names)}"
            for port, (kind, names) in wanted.items()
            for name in names
            if name not in inputs[port].names
        ]
        if missing:
            raise WiringError("\n".join(missing))
        self._links = [inputs[self._poses_port].names.index(name) for name in links]
        self._order = [inputs[self._state_port].names.index(name) for name in self._joints]

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the targets of this step, and what has happened."""
        log: list[Event] = []
        progress = self._progress
        if progress is None:
            progress = self._progress = self._begin(step, log)
        if progress.failure:
            raise RunError(progress.failure)
        gripper = step.read(self._sensor_port, GripperState)
        if gripper.holding != progress.holds:
            progress.holds, progress.holds_since_ns = gripper.holding, step.t_ns
        while self._is_done(progress, gripper, step.t_ns):
            self._enter(progress, NEXT[progress.stage], step.t_ns)
            if progress.stage in NEXT:
                text = f"{self._params.cube}: {progress.stage}"
                if progress.stage == "lift":
                    grip = f"{gripper.width * 1e3:.1f} mm wide with {gripper.force:.1f} N"
                    text = f"{text}, gripped {grip}"
                log.append(Event(level="info", text=text))
        failure = self._failure(progress, gripper, step.t_ns)
        summary = self._conclude(progress, failure, step)
        return {**self._commands(progress, step.t_ns), **self._events(log, summary)}

    def _cube(self, step: Step) -> Spot:
        """Return where the cube is."""
        poses = step.read(self._poses_port, Poses)
        base, cube = ((poses.position[i], poses.orientation[i]) for i in self._links)
        return spot_of(base, cube, self._params.cube)

    def _begin(self, step: Step, log: list[Event]) -> _Progress:
        """Return the state of a pick from where arm and cube are."""
        params, cube = self._params, self._cube(step)
        position = step.read(self._state_port, SensedJoints).position
        start = [position[index] for index in self._order]
        waypoints = plan(
            self._arm,
            cube,
            self._goal(cube.z),
            grip_height=params.grip_height,
            clearance=params.clearance,
        )
        log.append(Event(level="info", text=f"{params.cube} stands at {cube}"))
        first = motion(self._arm, start, waypoints["above_cube"], params.speed)
        return _Progress(waypoints, cube.z, first, since_ns=step.t_ns)

    def _goal(self, height: float) -> Spot:
        """Return where the cube shall stand; height: of its bottom [m]."""
        x, y, yaw = self._params.goal
        return Spot(x=x, y=y, z=height, yaw=yaw)

    def _is_done(self, progress: _Progress, gripper: GripperState, t_ns: int) -> bool:
        """Return whether the stage is over."""
        elapsed = (t_ns - progress.since_ns) * 1e-9
        if progress.stage == "over":
            return False
        if progress.stage == "grip":
            since_ns = max(progress.since_ns, progress.holds_since_ns)
            return progress.holds and (t_ns - since_ns) * 1e-9 >= _SURE
        if progress.stage == "release":
            return gripper.width > self._params.opening - _OPEN and not progress.holds
        return elapsed >= (_SETTLE if progress.stage == "settle" else progress.motion.duration)

    def _enter(self, progress: _Progress, stage: Stage, t_ns: int) -> None:
        """Begin a stage."""
        progress.stage, progress.since_ns = stage, t_ns
        if stage in MOVES:
            end = progress.waypoints[MOVES[stage]]
            progress.motion = motion(self._arm, progress.motion.end, end, self._params.speed)

    def _failure(self, progress: _Progress, gripper: GripperState, t_ns: int) -> str:
        """Return what has gone wrong in a stage; empty: nothing."""
        params, stage = self._params, progress.stage
        is_late = (t_ns - progress.since_ns) * 1e-9 >= params.patience
        apart = f"the fingers are {gripper.width * 1e3:.1f} mm apart"
        if stage == "grip" and is_late:
            where = f"{apart} and press with {gripper.force:.1f} N"
            return f"{params.cube} is not gripped after {params.patience:g} s: {where}"
        if stage == "release" and is_late:
            return f"{params.cube} is not released after {params.patience:g} s: {apart}"
        unheld = not progress.holds and (t_ns - progress.holds_since_ns) * 1e-9 >= _LOST
        if stage in CARRIES and unheld:
            return f"the gripper has lost {params.cube} ({stage}): {apart}"
        return ""

    def _conclude(self, progress: _Progress, failure: str, step: Step) -> Event | None:
        """Return the result where the pick is over; then end the run, or fail at the next step."""
        params, text = self._params, failure
        if progress.stage == "over" and not progress.is_concluded:
            cube, goal = self._cube(step), self._goal(progress.height)
            off, degrees = distance(cube, goal), math.degrees(turn(cube, goal))
            where = f"{off * 1e3:.2f} mm from its goal, turned by {degrees:.1f}°"
            text = f"{params.cube} stands {where}, after {step.t:.1f} s"
            if off > params.tolerance:
                failure = text = f"{text}; allowed are {params.tolerance * 1e3:g} mm"
            else:
                step.end(text)
        if not text:
            return None
        progress.is_concluded, progress.failure = True, failure
        return Event(level="error" if failure else "info", text=text)

    def _commands(self, progress: _Progress, t_ns: int) -> dict[str, Message]:
        """Return the commands of a step: each target leads to the next one in one period."""
        since, period = (t_ns - progress.since_ns) * 1e-9, self._period_ns * 1e-9
        moves = progress.stage in MOVES
        now = progress.motion.at(since if moves else math.inf)
        then = progress.motion.at(since + period if moves else math.inf)
        velocity = [(b - a) / period for a, b in zip(now, then, strict=True)]
        width = 0.0 if progress.stage in CLOSED else self._params.opening
        return {
            self._command_port: JointCommand(mode="position", values=now, velocity=velocity),
            self._gripper_port: GripperCommand(width=width, force=self._params.force),
        }

    def _events(self, log: list[Event], summary: Event | None) -> dict[str, Message]:
        """Return what has happened, a line each, and the result at its own port."""
        if summary is not None and self._summary_port == self._event_port:
            log = [*log, summary]
        messages: dict[str, Message] = {}
        if log:
            text = "\n".join(event.text for event in log)
            messages[self._event_port] = Event(level=log[-1].level, text=text)
        if summary is not None and self._summary_port != self._event_port:
            messages[self._summary_port] = summary
        return messages

    def save(self) -> bytes:
        """Return how far the pick is."""
        return msgspec.msgpack.encode(self._progress)

    def restore(self, state: bytes) -> None:
        """Take what `save` returned."""
        self._progress = msgspec.msgpack.decode(state, type=_Progress | None)
