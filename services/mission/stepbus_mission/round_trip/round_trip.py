"""Random poses that a robot can reach."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel
from stepbus_mission.round_trip import Params
from stepbus_participant import Config, Participant, Ports, Step, installed_version, suggest
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


class ReachablePoses:
    """Draws reachable poses of a robot from joint positions within its limits.

    path: URDF. frame: that the poses are given in. seed: of the draw.
    Raises WiringError for a file that is not a URDF, or an unknown frame.
    """

    def __init__(self, path: Path, frame: str, seed: int) -> None:
        self._robot = RobotModel(path)
        self._frame = frame
        self._random = np.random.Generator(np.random.PCG64(seed))
        self.check([frame])

    def check(self, tips: Sequence[str]) -> None:
        """Raise WiringError for unknown frames."""
        try:
            for tip in tips:
                self._robot.frame_id(tip)
        except RunError as exc:
            raise WiringError(str(exc)) from exc

    def draw(self, tip: str) -> Any:
        """Return a pose of a frame, as `pinocchio.SE3`; joints that do not move it are neutral."""
        robot = self._robot
        q = np.zeros(len(robot.joints))
        for index in robot.chain(tip):
            q[index] = self._random.uniform(robot.lower[index], robot.upper[index])
        return robot.frame_pose(q, self._frame).actInv(robot.frame_pose(q, tip))


@dataclass(frozen=True, kw_only=True)
class Trip:
    """The result of one pose.

    position_error [m], orientation_error [rad]: of the tip, measured by the plant. named: the
    controller's warning that the motors cannot hold the pose; empty: none. settled: whether it came
    to rest at the target.
    """

    position_error: float
    orientation_error: float
    named: str = ""
    settled: bool = True

    def is_good(self, position: float, orientation: float) -> bool:
        """Return whether it is within a tolerance [m, rad]."""
        return self.position_error <= position and self.orientation_error <= orientation

    def __str__(self) -> str:
        text = f"{self.position_error * 1e3:.3f} mm, {math.degrees(self.orientation_error):.4f}°"
        return text + ("" if self.settled else ", not settled")


def summary(
    arm: str, trips: Sequence[Trip], refused: Counter[str], position: float, orientation: float
) -> tuple[bool, str]:
    """Return whether exactly the named poses missed, and a sentence with the numbers.

    refused: cause → number of rejected poses. position [m], orientation [rad]: tolerance.
    """
    good = [trip for trip in trips if trip.is_good(position, orientation)]
    bad = [trip for trip in trips if not trip.is_good(position, orientation)]
    named = [trip for trip in trips if trip.named]
    unnamed_bad = sum(not trip.named for trip in bad)
    named_good = sum(trip.is_good(position, orientation) for trip in named)
    tolerance = f"{position * 1e3:g} mm and {math.degrees(orientation):.1f}°"
    parts = [f"{arm}: {len(good)} of {len(trips)} poses within {tolerance}"]
    if good:
        parts.append(_spread(good))
    parts.append(
        f"{len(named)} named not holdable beforehand, {len(named) - named_good} of them missed; "
        f"{unnamed_bad} missed without being named"
    )
    if refused:
        rows = ", ".join(f"{count} {cause}" for cause, count in sorted(refused.items()))
        parts.append(f"drawn and not gone to: {rows}")
    return not unnamed_bad and not named_good, "; ".join(parts)


def _spread(trips: Sequence[Trip]) -> str:
    positions = [trip.position_error * 1e3 for trip in trips]
    angles = [math.degrees(trip.orientation_error) for trip in trips]
    return (
        f"of these median {median(positions):.3f} mm and {median(angles):.4f}°, "
        f"worst {max(positions):.3f} mm and {max(angles):.4f}°"
    )


LogEntry = tuple[bool, str]
"""Whether all is well, and a sentence."""

_MOST_REJECTED = 100
_SUMMARY = "summary"
_OVER = ("succeeded", "failed", "cancelled")


class RoundTrip(Participant):
    """Sends each arm to random poses, in turn, until it has reached as many as the scenario asks.

    Inputs: one Poses/1, the true poses from the plant, and one GoalStatus/1. Outputs: one Goal/1
    and an Event/1 with one sentence per pose and, at the end, one per arm; then the run ends. An
    output of type Event/1 named `summary` carries the latter. A pose that the controller rejects is
    reported, counted and replaced. `Params` has the parameters.
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
        self._prefix, self._count = params.prefix, params.poses
        self._position = params.position_tolerance
        self._orientation = params.orientation_tolerance
        self._source = _make_source(config, params)
        self._trips: dict[str, list[Trip]] = {arm: [] for arm in self._arms}
        self._rejected: dict[str, Counter[str]] = {arm: Counter() for arm in self._arms}
        self._goal: Goal | None = None
        self._arm = ""
        self._named = ""
        self._must_go_home = False
        self._is_done = False
        self._rejected_in_a_row = 0

    def describe(self) -> Mapping[str, Description]:
        """Return empty descriptions: no output has named elements."""
        ports = (self._goal_port, self._event_port, self._summary_port)
        return dict.fromkeys(ports, Description())

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Find the links among those that the plant measures.

        Raises WiringError for links that it does not.
        """
        names = inputs[self._poses_port].names
        links = {name: self._prefix + name for name in (self._frame, *self._arms.values())}
        missing = [n for n in links.values() if n not in names]
        if missing:
            rows = (f"{self.config.name}: input {self._poses_port!r} has no link {n!r}"
                    f"{suggest(n, names)}" for n in missing)  # fmt: skip
            raise WiringError("\n".join(rows))
        self._index = {name: names.index(named) for name, named in links.items()}

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the next goal when the last one is over, and its result."""
        log: list[LogEntry] = []
        if self._is_done:
            return {}
        if self._goal is not None and not self._is_over(step, log):
            return _events(self._event_port, log)
        if self._must_go_home:
            return {self._goal_port: self._send_home(), **_events(self._event_port, log)}
        self._arm = self._next_arm()
        if self._arm:
            goal = self._next_goal()
            return {self._goal_port: goal, **_events(self._event_port, log)}
        return {**_events(self._event_port, log), **self._end(step, log)}

    def _end(self, step: Step, log: Sequence[LogEntry]) -> dict[str, Message]:
        """End the run and return the summary."""
        rows = [self._summary(arm) for arm in self._arms]
        self._is_done = True
        step.end(f"{self.config.name}: all poses have been gone to")
        shared = self._summary_port == self._event_port
        return _events(self._summary_port, [*log, *rows] if shared else rows)

    def _next_arm(self) -> str:
        """Return the arm with the fewest poses so far; empty: all are done."""
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
        self._must_go_home = False
        self._goal = Goal(
            id=self._next_id(),
            type="move_joints",
            joints=list(home),
            values=[float(value) for value in home.values()],
        )
        return self._goal

    def _next_id(self) -> int:
        return 0 if self._goal is None else self._goal.id + 1

    def _is_over(self, step: Step, log: list[LogEntry]) -> bool:
        """Return whether the current goal is over, and log its result."""
        status = step.get(self._status_port, GoalStatus)
        if status is None or self._goal is None or status.id != self._goal.id:
            return False
        if status.cause == "not_holdable" and status.state == "accepted" and not self._named:
            self._named = status.text
            log.append((False, f"{self._label()}: {status.text}"))
        if status.state not in _OVER:
            return False
        if self._goal.type == "move_joints":
            if status.state != "succeeded":
                log.append((False, f"{self._arm} did not come home: {status.text}"))
        elif status.cause in {"", "not_settled"}:
            self._record(step, status, log)
        else:
            self._reject(status)
            log.append((True, f"{self._label()}: not gone to, {status.text}"))
        return True

    def _reject(self, status: GoalStatus) -> None:
        """Count a rejected pose; raises RunError after too many in a row."""
        self._rejected[self._arm][status.cause] += 1
        self._rejected_in_a_row += 1
        if self._rejected_in_a_row >= _MOST_REJECTED:
            raise RunError(
                f"{self.config.name}: {_MOST_REJECTED} poses of {self._arm} in a row were refused, "
                f"the last for {status.cause!r} ({status.text}); are the motors too weak?"
            )

    def _label(self) -> str:
        return f"{self._arm} {len(self._trips[self._arm]) + 1}/{self._count}"

    def _record(self, step: Step, status: GoalStatus, log: list[LogEntry]) -> None:
        """Measure the tip and record its error."""
        self._rejected_in_a_row = 0
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
        log.append((is_good, text))
        self._must_go_home = not is_good and self._arm in self._home

    def _measured(self, step: Step) -> Any:
        """Return the true pose of the tip in the frame of the goals."""
        poses = step.read(self._poses_port, Poses)
        base, tip = (_pose(poses, self._index[n]) for n in (self._frame, self._arms[self._arm]))
        return base.actInv(tip)

    def _summary(self, arm: str) -> LogEntry:
        rows = self._trips[arm], self._rejected[arm], self._position, self._orientation
        return summary(arm, *rows)

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that the poses depend on."""
        return {"numpy": np.__version__, "pinocchio": installed_version("pin")}


def _target(goal: Goal | None) -> Any:
    if goal is None or goal.position is None or goal.orientation is None:
        raise RunError("a goal without a pose has ended")
    turn = pin.Quaternion(np.array(goal.orientation))
    return pin.SE3(turn.matrix(), np.array(goal.position))


def _pose(poses: Poses, index: int) -> Any:
    turn = pin.Quaternion(np.array(poses.orientation[index]))
    return pin.SE3(turn.matrix(), np.array(poses.position[index]))


def _events(port: str, log: Sequence[LogEntry]) -> dict[str, Message]:
    """Return the log as one message, a line per entry."""
    if not log:
        return {}
    text = "\n".join(text for _, text in log)
    fine = all(fine for fine, _ in log)
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
