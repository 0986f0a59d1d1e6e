"""The tester: takes the place of a controller, and commands each joint in turn by a known plan."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from stepbus_participant import Participant, Step
from stepbus_schemas import Description, JointCommand, JointState, Message, RunError
from stepbus_tools.columns import limits_of

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

    @property
    def type(self) -> str:
        """Return how it moves."""
        return "revolute" if self.is_rotary else "prismatic"

    @property
    def units(self) -> tuple[str, str]:
        """Return the units of its effort and of its velocity."""
        return ("N·m", "rad/s") if self.is_rotary else ("N", "m/s")

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
    def push(self) -> float:
        """Return the torque it is pushed with [N·m]."""
        return _SHARE_OF_EFFORT * self.effort if math.isfinite(self.effort) else 1.0


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What is done to one joint once; steps are those of the tester.

    goal: target position [rad]. first: step it starts with. measure: step at which the joint is
    where it was sent. pushes: those after the two pushes of mode torque, forward and back. script:
    mode and value of the joint's commands from `first` on; the others rest.
    """

    joint: TestedJoint
    goal: float
    first: int
    measure: int
    pushes: tuple[int, int]
    script: Sequence[tuple[str, float]]

    @property
    def end(self) -> int:
        """Return the first step of the next trial."""
        return self.first + len(self.script)


def read_joints(description: Description, start: Sequence[float] = ()) -> list[TestedJoint]:
    """Return the joints of a description; start: their positions, shape (n,) [rad]."""
    count, limits = len(description.names), description.limits
    types = description.details.get("type", ["revolute"] * count)
    modes = description.details.get("mode", ["position"] * count)
    joints = []
    for i, name in enumerate(description.names):
        lower, upper = limits_of(limits, "position", i)
        joints.append(
            TestedJoint(
                index=i,
                name=name,
                is_rotary=types[i] != "prismatic",
                mode=modes[i],
                lower=lower,
                upper=upper,
                # A velocity limit of 0 is how a URDF states that there is none.
                speed=limits_of(limits, "velocity", i)[1] or math.inf,
                effort=limits_of(limits, "effort", i)[1],
                start=start[i] if start else 0.0,
            )
        )
    return joints


def by_mode(joints: Sequence[TestedJoint]) -> dict[str, list[TestedJoint]]:
    """Return the joints with a motor by their mode, in the order of the joints."""
    groups: dict[str, list[TestedJoint]] = {}
    for joint in joints:
        if joint.mode != "passive":
            groups.setdefault(joint.mode, []).append(joint)
    return groups


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
        plan.append(_trial(joint, goal, first, settle, step_s))
        first = plan[-1].end
    return plan


def _trial(joint: TestedJoint, goal: float, first: int, settle: int, step_s: float) -> Trial:
    way = goal - joint.start
    pace = min(_SHARE_OF_SPEED * joint.speed, _SPEED[joint.is_rotary])
    pushes = first, first
    if joint.mode == "position":
        rise = math.ceil(_PEAK * abs(way) / pace / step_s)
        measure = rise + settle
        parts = [min(i, measure + rise - i) / max(rise, 1) for i in range(2 * measure)]
        script = [("position", _on_the_way(joint.start, goal, part)) for part in parts]
    elif joint.mode == "velocity":
        rise = max(1, round(abs(way) / pace / step_s))
        measure = rise + settle
        speed = way / (rise * step_s)
        speeds = (*[speed] * rise, *[0.0] * settle, *[-speed] * rise, *[0.0] * settle)
        script = [("velocity", value) for value in speeds]
    else:
        put, back, let_go = ("teleport", goal), ("teleport", joint.start), ("torque", 0.0)
        script = []
        if joint.mode == "torque":
            rise = max(1, round(_PUSH_S / step_s))
            pushes = first + 2 + rise, first + 2 * (2 + rise)
            for push in (joint.push, -joint.push):
                script += [let_go, back, *[("torque", push)] * rise]
            script += [let_go, put, let_go, back]
        else:
            script = [put, *[back] * 7]
        measure = script.index(put) + 1
    return Trial(
        joint=joint, goal=goal, first=first, measure=first + measure, pushes=pushes, script=script
    )


def _on_the_way(start: float, goal: float, part: float) -> float:
    """Return a position of a motion of least jerk; part: of its time, where it is not over."""
    if part >= 1.0:
        # Not a rounding error beyond it, where it is a stop.
        return goal
    part = max(part, 0.0)
    return start + part**3 * (10 - 15 * part + 6 * part**2) * (goal - start)


def commands_at(
    step: int, plan: Sequence[Trial], joints: Sequence[TestedJoint], step_s: float
) -> Iterator[tuple[str, JointCommand]]:
    """Yield (mode, command for all joints of that mode) of a step of the tester."""
    trial = next((t for t in plan if t.first <= step < t.end), None)
    for mode, group in by_mode(joints).items():
        active = trial if trial is not None and trial.joint.mode == mode else None
        current, values = _values(mode, group, active, step)
        if mode == "position":
            _, ahead = _values(mode, group, active, step + 1)
            velocity = [(after - now) / step_s for now, after in zip(values, ahead, strict=True)]
            yield mode, JointCommand(mode="position", values=values, velocity=velocity)
        else:
            yield mode, JointCommand(mode=current, values=values)


def _values(
    mode: str, group: Sequence[TestedJoint], trial: Trial | None, step: int
) -> tuple[Any, list[float]]:
    """Return the mode and the values of a command; all joints rest but that of the trial."""
    value: float | None = None
    if trial is not None and step < trial.end:
        mode, value = trial.script[step - trial.first]
    is_place = mode in {"position", "teleport"}
    values = [joint.start if is_place else 0.0 for joint in group]
    if trial is not None and value is not None:
        values[group.index(trial.joint)] = value
    return mode, values


class Tester(Participant):
    """Commands every joint in turn, and ends the run after the last.

    Its input is the joint state; its outputs are named as the modes they command. Parameters:
    angle [rad]; only: names of the joints to test; names: of all joints of each mode.
    """

    def describe(self) -> Mapping[str, Description]:
        """Return the names of each output; known once the plant has described them."""
        names = self.config.params["names"]
        return {mode: Description(names=names[mode]) for mode in self.config.outputs}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Take in what the plant says of its joints."""
        ((self._input, self._description),) = inputs.items()
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
