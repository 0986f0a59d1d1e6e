"""What the self-test commands: its trials, the same for tester and judge."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from stepbus_participant import Participant, Step
from stepbus_schemas import Description, JointCommand, JointState, Message, RunError

# What is commanded where nothing limits it [rad/s, m/s], and how much of a limit is used.
_SPEED = {True: 2.0, False: 0.1}
_SHARE_OF_SPEED = 0.8
_SHARE_OF_EFFORT = 0.2
# A prismatic joint goes this far [m]; less than _LEAST is hard to distinguish from noise [rad, m].
_STROKE = 0.05
_LEAST = {True: math.radians(10), False: 0.005}
_SETTLE_S = 0.5
_PUSH_S = 0.1
_THERE_AND_BACK = ("position", "velocity")
# Peak over mean velocity of a motion of least jerk.
_PEAK = 1.875


@dataclass(frozen=True, kw_only=True)
class TestedJoint:
    """One joint, as its description gives it; prismatic ones in [m] and [N].

    index: its index in the joint state. lower, upper: stops [rad]. speed [rad/s] and effort
    [N·m]: largest ones; infinite where it is not given. start: where it stands before its trial.
    """

    index: int
    name: str
    is_rotary: bool
    mode: str
    lower: float
    upper: float
    speed: float
    effort: float
    start: float

    def goals(self, angle: float) -> list[float]:
        """Return where it is sent: to plus and minus an angle [rad], as far as its stops allow.

        Two, since on one side the robot may be in its own path. Fewer where a stop is too near.
        """
        want = angle if self.is_rotary else math.copysign(_STROKE, angle)
        ends = [min(max(end, self.lower), self.upper) for end in (want, -want)]
        far = [end for end in ends if abs(end - self.start) >= _LEAST[self.is_rotary]]
        if self.mode in _THERE_AND_BACK:
            return far or [max(ends, key=lambda end: abs(end - self.start))]
        return (far or ends)[:1]

    @property
    def pace(self) -> float:
        """Return how fast it is moved [rad/s]."""
        return min(_SHARE_OF_SPEED * self.speed, _SPEED[self.is_rotary])

    @property
    def push(self) -> float:
        """Return the torque it is pushed with [N·m]."""
        return _SHARE_OF_EFFORT * self.effort if math.isfinite(self.effort) else 1.0


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What is done to one joint once; steps are those of the tester.

    first: step it starts with. goal: target position [rad]. rise: steps of the motion. settle:
    steps to settle after it. end: first step of the next trial.
    """

    joint: TestedJoint
    goal: float
    first: int
    rise: int
    settle: int
    end: int = 0

    @property
    def measure(self) -> int:
        """Return the step at which the joint should have arrived."""
        return self.first + self.rise + self.settle

    @property
    def pushes(self) -> tuple[int, int]:
        """Return the steps after the two pushes of mode torque, forward and back."""
        return self.first + 2 + self.rise, self.first + 2 * (2 + self.rise)

    @property
    def jump(self) -> int:
        """Return the step at which a joint of mode torque or teleport is put at its goal."""
        return self.first + (2 * (2 + self.rise) + 1 if self.joint.mode == "torque" else 0)


def read_joints(description: Description, start: Sequence[float]) -> list[TestedJoint]:
    """Return the joints of a description; start: their positions, shape (n,) [rad]."""
    count = len(description.names)
    unlimited = [math.inf] * count
    limits = {
        key: description.limits.get(key, unlimited) for key in ("upper", "velocity", "effort")
    }
    lower = description.limits.get("lower", [-math.inf] * count)
    return [
        TestedJoint(
            index=i,
            name=name,
            is_rotary=description.details.get("type", ["revolute"] * count)[i] != "prismatic",
            mode=description.details.get("mode", ["position"] * count)[i],
            lower=lower[i],
            upper=limits["upper"][i],
            # A velocity limit of 0 is how a URDF states that there is none.
            speed=limits["velocity"][i] or math.inf,
            effort=limits["effort"][i],
            start=start[i],
        )
        for i, name in enumerate(description.names)
    ]


def modes_of(description: Description) -> list[str]:
    """Return the modes that commands are needed for, in the order of the joints."""
    joints = read_joints(description, [0.0] * len(description.names))
    return list(dict.fromkeys(joint.mode for joint in joints if joint.mode != "passive"))


def make_plan(
    joints: Sequence[TestedJoint], step_s: float, angle: float, only: Sequence[str]
) -> list[Trial]:
    """Return the trials, one after the other; joints without a motor have none.

    step_s: from one command to the next [s]. angle: to send rotary joints to [rad]. only: names
    of the joints to test.
    """
    first = settle = max(1, round(_SETTLE_S / step_s))
    plan: list[Trial] = []
    moved = [joint for joint in joints if joint.mode != "passive" and joint.name in only]
    for joint, goal in ((item, goal) for item in moved for goal in item.goals(angle)):
        distance = abs(goal - joint.start)
        rises = {
            "position": math.ceil(_PEAK * distance / joint.pace / step_s),
            "velocity": max(1, round(distance / joint.pace / step_s)),
            "torque": max(1, round(_PUSH_S / step_s)),
        }
        rise = rises.get(joint.mode, 0)
        trial = Trial(joint=joint, goal=goal, first=first, rise=rise, settle=settle)
        # Back again, and the same pause before the next.
        length = 2 * (rise + settle) if joint.mode in _THERE_AND_BACK else 2 * rise + 8
        plan.append(replace(trial, end=first + length))
        first = plan[-1].end
    return plan


def commands_at(
    step: int, plan: Sequence[Trial], joints: Sequence[TestedJoint], step_s: float
) -> Iterator[tuple[str, JointCommand]]:
    """Yield (mode, command for all joints of that mode) of a step of the tester."""
    trial = next((t for t in plan if t.first <= step < t.end), None)
    for mode in dict.fromkeys(joint.mode for joint in joints if joint.mode != "passive"):
        group = [joint for joint in joints if joint.mode == mode]
        mine = trial if trial is not None and trial.joint.mode == mode else None
        yield mode, _command(mode, group, step, mine, step_s)


def _command(
    mode: str, group: Sequence[TestedJoint], step: int, trial: Trial | None, step_s: float
) -> JointCommand:
    if mode == "position":
        return _position(group, step, trial, step_s)
    if mode == "velocity":
        return _velocity(group, step, trial, step_s)
    if mode == "torque":
        return _torque(group, step, trial)
    jumped = trial if trial is not None and step == trial.jump else None
    return _teleport(group, jumped)


def _position(
    group: Sequence[TestedJoint], step: int, trial: Trial | None, step_s: float
) -> JointCommand:
    values = [_way(joint, step, trial) for joint in group]
    ahead = [_way(joint, step + 1, trial) for joint in group]
    velocity = [(after - now) / step_s for now, after in zip(values, ahead, strict=True)]
    return JointCommand(mode="position", values=values, velocity=velocity)


def _way(joint: TestedJoint, step: int, trial: Trial | None) -> float:
    """Return the target of a joint: there and back again, with least jerk."""
    if trial is None or trial.joint is not joint:
        return joint.start
    there = (step - trial.first) / max(trial.rise, 1)
    back = (trial.measure + trial.rise - step) / max(trial.rise, 1)
    part = min(max(min(there, back), 0.0), 1.0)
    if part == 1.0:
        # Not a rounding error beyond it, where it is a stop.
        return trial.goal
    share = part**3 * (10 - 15 * part + 6 * part**2)
    return joint.start + share * (trial.goal - joint.start)


def _velocity(
    group: Sequence[TestedJoint], step: int, trial: Trial | None, step_s: float
) -> JointCommand:
    values = [0.0] * len(group)
    if trial is not None:
        speed = (trial.goal - trial.joint.start) / (trial.rise * step_s)
        if step < trial.first + trial.rise:
            values[group.index(trial.joint)] = speed
        elif trial.measure <= step < trial.measure + trial.rise:
            values[group.index(trial.joint)] = -speed
    return JointCommand(mode="velocity", values=values)


def _torque(group: Sequence[TestedJoint], step: int, trial: Trial | None) -> JointCommand:
    """Let go, put all at the start, push; the same with the opposite push; put at the goal."""
    values = [0.0] * len(group)
    if trial is None:
        return JointCommand(mode="torque", values=values)
    half = 2 + trial.rise
    turn, index = divmod(step - trial.first, half)
    if step == trial.jump:
        return _teleport(group, trial)
    if (turn < 2 and index == 1) or step == trial.end - 1:
        return _teleport(group, None)
    if turn < 2 and index >= 2:
        values[group.index(trial.joint)] = trial.joint.push * (1 if turn == 0 else -1)
    return JointCommand(mode="torque", values=values)


def _teleport(group: Sequence[TestedJoint], trial: Trial | None) -> JointCommand:
    """Put all joints at their start, but one at its goal."""
    values = [
        trial.goal if trial is not None and trial.joint is joint else joint.start for joint in group
    ]
    return JointCommand(mode="teleport", values=values)


class Tester(Participant):
    """Commands every joint in turn, and ends the run after the last.

    Its input is the joint state; its outputs are named as the modes they command. Parameters:
    angle [rad]; only: names of the joints to test; names: of all joints of each mode.
    """

    def describe(self) -> Mapping[str, Description]:
        """Return the names of each output; known once the plant has described them."""
        return {
            mode: Description(names=self.config.params["names"][mode])
            for mode in self.config.outputs
        }

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Take in what the plant says of its joints."""
        (self._description,) = inputs.values()
        (self._input,) = inputs
        self._plan: list[Trial] = []

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the commands of this step."""
        step_s = self.config.every * self.config.step_ns * 1e-9
        count = step.index // self.config.every
        if count == 0:
            state = step.read(self._input, JointState)
            if state.position is None:
                raise RunError(f"{self.config.name}: the plant senses no positions")
            self._joints = read_joints(self._description, state.position)
            params = self.config.params
            self._plan = make_plan(self._joints, step_s, params["angle"], params["only"])
        if not self._plan or count >= self._plan[-1].end:
            step.end("all joints have been tested")
        return dict(commands_at(count, self._plan, self._joints, step_s))
