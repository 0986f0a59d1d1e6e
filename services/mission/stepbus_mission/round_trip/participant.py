"""Send hands to random poses, measure where they come to.

Run as `python -m stepbus_mission.round_trip`. It is the proof that joint angles arrive: the target
comes from the model, the measurement from the plant, and between them lie inverse kinematics, the
bus, the motors and gravity.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_participant import Config, Participant, Ports, Step, suggest
from stepbus_schemas import (
    Description,
    Event,
    Goal,
    GoalStatus,
    Message,
    Poses,
    RunError,
    WiringError,
)

from .params import Params
from .report import Trip, summary

Told = tuple[bool, str]
"""A sentence, and whether all is well."""

_MOST_REFUSED = 100
_SUMMARY = "summary"
_OVER = ("succeeded", "failed", "cancelled")


class ReachablePoses:
    """Draws poses that a robot can reach, out of joint positions within its limits.

    path: URDF. frame: that the poses are given in. seed: of the draw.
    Raises WiringError for a file that is no URDF.
    """

    def __init__(self, path: Path, frame: str, seed: int) -> None:
        try:
            self._model = pin.buildModelFromUrdf(str(path))
        except ValueError as exc:
            raise WiringError(f"{path} is not a URDF that Pinocchio can read") from exc
        self._data = self._model.createData()
        self._path = path
        self._frame = self._number(frame)
        self._random = np.random.Generator(np.random.PCG64(seed))

    def check(self, tips: Sequence[str]) -> None:
        """Raise WiringError for frames that the model lacks."""
        for tip in tips:
            self._number(tip)

    def _number(self, frame: str) -> int:
        if not self._model.existFrame(frame):
            known = [row.name for row in self._model.frames]
            raise WiringError(f"frame {frame!r} is not in {self._path}{suggest(frame, known)}")
        number: int = self._model.getFrameId(frame)
        return number

    def draw(self, tip: str) -> Any:
        """Return a pose of a frame, as `pinocchio.SE3`; the joints that do not move it: neutral."""
        model, number = self._model, self._number(tip)
        q = pin.neutral(model)
        for joint in model.supports[model.frames[number].parentJoint]:
            if joint:
                at = model.idx_qs[joint]
                q[at] = self._random.uniform(
                    model.lowerPositionLimit[at], model.upperPositionLimit[at]
                )
        pin.framesForwardKinematics(model, self._data, q)
        return self._data.oMf[self._frame].actInv(self._data.oMf[number])


class RoundTrip(Participant):
    """Sends each arm in turn to poses until as many have been gone to as the scenario wants.

    Inputs: one Poses/1, the truth of the plant, and one GoalStatus/1. Outputs: one Goal/1 and an
    Event/1 with a sentence per pose and one per arm at the end; then the run ends. A pose that
    the controller refuses is told, counted and replaced by another one.

    Parameters: model, a URDF; frame, a link of it that the plant measures as well; arms, a map
    from a name to the link that is sent; poses, of each arm; position_tolerance [m] and
    orientation_tolerance [rad], where a pose counts as missed; home, a map from each arm to a map
    from joints to [rad], where it goes after a pose that it has missed: it hangs in its motors
    then. An output of type Event/1 with the name `summary` gets the sentences at the end.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._poses_port = ports.input_of("Poses/1")
        self._status_port = ports.input_of("GoalStatus/1")
        self._goal_port = ports.output_of("Goal/1")
        self._event_port, self._summary_port = ports.event_outputs()
        ports.outputs_are("Goal/1", "Event/1")
        params = config.read(Params, ports.problems)
        self._frame, self._arms, self._home = params.frame, params.arms, params.home
        self._count = params.poses
        self._position = params.position_tolerance
        self._orientation = params.orientation_tolerance
        self._source = _make_source(config, params)
        self._trips: dict[str, list[Trip]] = {arm: [] for arm in self._arms}
        self._refused: dict[str, Counter[str]] = {arm: Counter() for arm in self._arms}
        self._goal: Goal | None = None
        self._arm = ""
        self._named = ""
        self._has_to_go_home = False
        self._is_done = False
        self._refused_in_a_row = 0

    def describe(self) -> Mapping[str, Description]:
        """Return that nothing here has names."""
        ports = (self._goal_port, self._event_port, self._summary_port)
        return dict.fromkeys(ports, Description())

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Find the links among those that the plant measures."""
        names = inputs[self._poses_port].names
        wanted = [self._frame, *self._arms.values()]
        missing = [n for n in wanted if n not in names]
        if missing:
            rows = (f"{self.config.name}: input {self._poses_port!r} has no link {n!r}"
                    f"{suggest(n, names)}" for n in missing)  # fmt: skip
            raise WiringError("\n".join(rows))
        self._at = {name: names.index(name) for name in wanted}

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the next goal, where the last one is over, and what became of that."""
        told: list[Told] = []
        if self._is_done:
            return {}
        if self._goal is not None and not self._is_over(step, told):
            return _events(self._event_port, told)
        if self._has_to_go_home:
            return {self._goal_port: self._send_home(), **_events(self._event_port, told)}
        self._arm = self._next_arm()
        if self._arm:
            goal = self._next_goal()
            return {self._goal_port: goal, **_events(self._event_port, told)}
        return {**_events(self._event_port, told), **self._end(step, told)}

    def _end(self, step: Step, told: Sequence[Told]) -> dict[str, Message]:
        """Ask for the end of the run and return the summary."""
        rows = [self._summary(arm) for arm in self._arms]
        self._is_done = True
        step.end(f"{self.config.name}: all poses have been gone to")
        shared = self._summary_port == self._event_port
        return _events(self._summary_port, [*told, *rows] if shared else rows)

    def _next_arm(self) -> str:
        """Return the arm with the fewest poses behind it; empty: all are done."""
        left = [arm for arm in self._arms if len(self._trips[arm]) < self._count]
        return min(left, key=lambda arm: len(self._trips[arm]), default="")

    def _next_goal(self) -> Goal:
        target = self._source.draw(self._arms[self._arm])
        turn = pin.Quaternion(target.rotation)
        x, y, z = target.translation.tolist()
        self._named = ""
        self._goal = Goal(
            id=self._next_id(),
            type="move_to_pose",
            tip=self._arms[self._arm],
            frame=self._frame,
            position=(x, y, z),
            orientation=(float(turn.x), float(turn.y), float(turn.z), float(turn.w)),
        )
        return self._goal

    def _send_home(self) -> Goal:
        home = self._home[self._arm]
        self._has_to_go_home = False
        self._goal = Goal(
            id=self._next_id(),
            type="move_joints",
            joints=list(home),
            values=[float(value) for value in home.values()],
        )
        return self._goal

    def _next_id(self) -> int:
        return 0 if self._goal is None else self._goal.id + 1

    def _is_over(self, step: Step, told: list[Told]) -> bool:
        """Return whether the goal under way has come to its end; told: what there is to say."""
        status = step.get(self._status_port, GoalStatus)
        if status is None or self._goal is None or status.id != self._goal.id:
            return False
        if status.cause == "not_holdable" and status.state == "accepted" and not self._named:
            self._named = status.text
            told.append((False, f"{self._label()}: {status.text}"))
        if status.state not in _OVER:
            return False
        if self._goal.type == "move_joints":
            if status.state != "succeeded":
                told.append((False, f"{self._arm} did not come home: {status.text}"))
        elif status.cause in {"", "not_settled"}:
            self._note(step, status, told)
        else:
            self._refuse(status)
            told.append((True, f"{self._label()}: not gone to, {status.text}"))
        return True

    def _refuse(self, status: GoalStatus) -> None:
        """Count a pose that was not gone to; raises RunError where there is nothing but those."""
        self._refused[self._arm][status.cause] += 1
        self._refused_in_a_row += 1
        if self._refused_in_a_row >= _MOST_REFUSED:
            raise RunError(
                f"{self.config.name}: {_MOST_REFUSED} poses of {self._arm} in a row were refused, "
                f"the last for {status.cause!r} ({status.text}); are the motors too weak?"
            )

    def _label(self) -> str:
        return f"{self._arm} {len(self._trips[self._arm]) + 1}/{self._count}"

    def _note(self, step: Step, status: GoalStatus, told: list[Told]) -> None:
        """Measure the hand and keep how far off it is."""
        self._refused_in_a_row = 0
        off = self._measured(step).actInv(_target(self._goal))
        trip = Trip(
            position_error=float(np.linalg.norm(off.translation)),
            orientation_error=float(np.linalg.norm(pin.log3(off.rotation))),
            named=self._named,
            settled=status.state == "succeeded",
        )
        text = f"{self._label()}: {trip}" + (f"; {status.text}" if not trip.settled else "")
        self._trips[self._arm].append(trip)
        is_good = trip.is_good(self._position, self._orientation)
        told.append((is_good, text))
        self._has_to_go_home = not is_good and self._arm in self._home

    def _measured(self, step: Step) -> Any:
        """Return where the plant has the hand, in the frame of the goals."""
        poses = step.read(self._poses_port, Poses)
        base, hand = (_pose(poses, self._at[n]) for n in (self._frame, self._arms[self._arm]))
        return base.actInv(hand)

    def _summary(self, arm: str) -> Told:
        rows = self._trips[arm], self._refused[arm], self._position, self._orientation
        return summary(arm, *rows)

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the poses."""
        return {"numpy": np.__version__, "pinocchio": version("pin")}


def _target(goal: Goal | None) -> Any:
    if goal is None or goal.position is None or goal.orientation is None:
        raise RunError("a pose came to its end that nobody asked for")
    turn = pin.Quaternion(np.array(goal.orientation))
    return pin.SE3(turn.matrix(), np.array(goal.position))


def _pose(poses: Poses, place: int) -> Any:
    turn = pin.Quaternion(np.array(poses.orientation[place]))
    return pin.SE3(turn.matrix(), np.array(poses.position[place]))


def _events(port: str, told: Sequence[Told]) -> dict[str, Message]:
    """Return what is told as one message, a line each."""
    if not told:
        return {}
    text = "\n".join(text for _, text in told)
    fine = all(fine for fine, _ in told)
    return {port: Event(level="info" if fine else "warning", text=text)}


def _make_source(config: Config, params: Params) -> ReachablePoses:
    problems = config.problems()
    try:
        source = ReachablePoses(params.model, params.frame, config.seed)
        source.check(list(params.arms.values()))
    except WiringError as exc:
        problems.add_error(("params", "model"), exc)
        raise problems.error() from exc
    return source
