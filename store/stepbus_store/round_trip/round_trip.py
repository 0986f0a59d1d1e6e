"""The round trip: sends arms to random reachable poses and measures their errors."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel
from stepbus_participant import Config, Ports, Step, installed_version, suggest
from stepbus_schemas import (
    Description,
    Event,
    Goal,
    GoalStatus,
    Message,
    Point,
    Poses,
    Quaternion,
    RunError,
    WiringError,
)
from stepbus_store.memory import Remembering

from .params import Params

LogEntry = tuple[bool, str]
"""Whether all is well, and a sentence."""

_MOST_REJECTED = 100
_OVER = ("succeeded", "failed", "cancelled")


@dataclass(frozen=True, kw_only=True)
class Trip:
    """The result of one pose.

    position_error [m], orientation_error [rad]: of the tip, measured by the plant. is_good: whether
    both are within the tolerance. is_named: whether the controller has warned that the motors
    cannot hold the pose. settled: whether it came to rest at the target.
    """

    position_error: float
    orientation_error: float
    is_good: bool
    is_named: bool
    settled: bool

    def __str__(self) -> str:
        text = f"{self.position_error * 1e3:.3f} mm, {math.degrees(self.orientation_error):.4f}°"
        return text + ("" if self.settled else ", not settled")


def summary(arm: str, trips: Sequence[Trip], refused: Counter[str], tolerance: str) -> LogEntry:
    """Return whether exactly the named poses missed, and a sentence with the numbers.

    refused: cause → number of rejected poses.
    """
    good = [trip for trip in trips if trip.is_good]
    named = sum(trip.is_named for trip in trips)
    named_good = sum(trip.is_named for trip in good)
    unnamed_bad = sum(not (trip.is_named or trip.is_good) for trip in trips)
    parts = [f"{arm}: {len(good)} of {len(trips)} poses within {tolerance}"]
    if good:
        positions = [trip.position_error * 1e3 for trip in good]
        angles = [math.degrees(trip.orientation_error) for trip in good]
        parts.append(
            f"of these median {median(positions):.3f} mm and {median(angles):.4f}°, "
            f"worst {max(positions):.3f} mm and {max(angles):.4f}°"
        )
    parts.append(
        f"{named} named not holdable beforehand, {named - named_good} of them missed; "
        f"{unnamed_bad} missed without being named"
    )
    if refused:
        counts = ", ".join(f"{count} {cause}" for cause, count in sorted(refused.items()))
        parts.append(f"drawn and not gone to: {counts}")
    return not unnamed_bad and not named_good, "; ".join(parts)


class RoundTrip(Remembering):
    """Sends each arm to random poses, in turn, until it has reached the number in the scenario.

    Inputs: one Poses/1, the true poses from the plant, and one GoalStatus/1. Outputs: one Goal/1
    and an Event/1 with one message per pose and, at the end, one per arm; then the run ends. An
    output of type Event/1 named `summary` carries the latter. A pose that the controller rejects
    is reported, counted and replaced. Parameters: see `Params`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._poses_port = ports.input_of("Poses/1")
        self._status_port = ports.input_of("GoalStatus/1")
        self._goal_port = ports.output_of("Goal/1")
        self._event_port, self._summary_port = ports.event_outputs()
        ports.outputs_are("Goal/1", "Event/1")
        params = self._params = config.read(Params, ports.problems)
        problems, links = config.problems(), (params.frame, *params.arms.values())
        robot = problems.attempt(("params", "model"), lambda: RobotModel(params.model, links=links))
        if robot is None:
            raise problems.error()
        self._robot = robot
        self._random = np.random.Generator(np.random.PCG64(config.seed))
        self._trips: dict[str, list[Trip]] = {arm: [] for arm in params.arms}
        self._rejected: dict[str, Counter[str]] = {arm: Counter() for arm in params.arms}
        self._goal: Goal | None = None
        self._arm = ""
        self._is_named = False
        self._must_go_home = False
        self._is_done = False
        self._rejected_in_a_row = 0

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Find the links among those that the plant measures.

        Raises WiringError for links that it does not.
        """
        known, params = inputs[self._poses_port].names, self._params
        links = {name: params.prefix + name for name in (params.frame, *params.arms.values())}
        missing = [
            f"input {self._poses_port!r} has no link {link!r}{suggest(link, known)}"
            for link in links.values()
            if link not in known
        ]
        if missing:
            raise WiringError("\n".join(missing))
        self._index = {name: known.index(link) for name, link in links.items()}
        self.remember()

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the next goal when the last one is over, and its result."""
        log: list[LogEntry] = []
        if self._is_done:
            return {}
        if self._goal is not None and not self._is_over(self._goal, step, log):
            return _events(self._event_port, log)
        left = [arm for arm, trips in self._trips.items() if len(trips) < self._params.poses]
        if self._must_go_home or left:
            number = 0 if self._goal is None else self._goal.id + 1
            if self._must_go_home:
                self._goal = self._way_home(number)
            else:
                # The arm with the fewest poses so far.
                self._arm = min(left, key=lambda arm: len(self._trips[arm]))
                self._goal = self._way_to_a_pose(number)
            return {self._goal_port: self._goal, **_events(self._event_port, log)}
        self._is_done = True
        step.end("all poses have been gone to")
        degrees = math.degrees(self._params.orientation_tolerance)
        within = f"{self._params.position_tolerance * 1e3:g} mm and {degrees:.1f}°"
        rows = [summary(arm, row, self._rejected[arm], within) for arm, row in self._trips.items()]
        if self._summary_port == self._event_port:
            return _events(self._event_port, [*log, *rows])
        return {**_events(self._event_port, log), **_events(self._summary_port, rows)}

    def _way_to_a_pose(self, number: int) -> Goal:
        """Return a goal at a pose that joints within their limits reach."""
        robot, frame, tip = self._robot, self._params.frame, self._params.arms[self._arm]
        # Joints that do not move the tip are neutral.
        q = np.zeros(len(robot.joints))
        for index in robot.chain(tip):
            q[index] = self._random.uniform(robot.lower[index], robot.upper[index])
        target = robot.frame_pose(q, frame).actInv(robot.frame_pose(q, tip))
        turn = pin.Quaternion(target.rotation)
        x, y, z = target.translation.tolist()
        self._is_named = False
        return Goal(
            id=number,
            type="move_to_pose",
            tip=tip,
            frame=frame,
            position=(x, y, z),
            orientation=(float(turn.x), float(turn.y), float(turn.z), float(turn.w)),
        )

    def _way_home(self, number: int) -> Goal:
        home, self._must_go_home = self._params.home[self._arm], False
        return Goal(id=number, type="move_joints", joints=list(home), values=list(home.values()))

    def _is_over(self, goal: Goal, step: Step, log: list[LogEntry]) -> bool:
        """Return whether the current goal is over, and log its result."""
        status = step.get(self._status_port, GoalStatus)
        if status is None or status.id != goal.id:
            return False
        if goal.position is None or goal.orientation is None:
            if status.state in _OVER[1:]:
                log.append((False, f"{self._arm} did not come home: {status.text}"))
            return status.state in _OVER
        label = f"{self._arm} {len(self._trips[self._arm]) + 1}/{self._params.poses}"
        if status.cause == "not_holdable" and status.state == "accepted" and not self._is_named:
            self._is_named = True
            log.append((False, f"{label}: {status.text}"))
        if status.state not in _OVER:
            return False
        if status.cause in {"", "not_settled"}:
            trip = self._record(step, _pose(goal.position, goal.orientation), status)
            text = f"; {status.text}" if not trip.settled else ""
            log.append((trip.is_good, f"{label}: {trip}{text}"))
        else:
            self._reject(status)
            log.append((True, f"{label}: not gone to, {status.text}"))
        return True

    def _reject(self, status: GoalStatus) -> None:
        """Count a rejected pose; raises RunError after too many in a row."""
        self._rejected[self._arm][status.cause] += 1
        self._rejected_in_a_row += 1
        if self._rejected_in_a_row >= _MOST_REJECTED:
            raise RunError(
                f"{_MOST_REJECTED} poses of {self._arm} in a row were refused, "
                f"the last for {status.cause!r} ({status.text}); are the motors too weak?"
            )

    def _record(self, step: Step, target: Any, status: GoalStatus) -> Trip:
        """Measure the tip, and record and return its error."""
        self._rejected_in_a_row = 0
        poses, params = step.read(self._poses_port, Poses), self._params
        at = [self._index[name] for name in (params.frame, params.arms[self._arm])]
        base, tip = (_pose(poses.position[n], poses.orientation[n]) for n in at)
        off = base.actInv(tip).actInv(target)
        position = float(np.linalg.norm(off.translation))
        orientation = float(np.linalg.norm(pin.log3(off.rotation)))
        is_near = position <= params.position_tolerance
        trip = Trip(
            position_error=position,
            orientation_error=orientation,
            is_good=is_near and orientation <= params.orientation_tolerance,
            is_named=self._is_named,
            settled=status.state == "succeeded",
        )
        self._trips[self._arm].append(trip)
        self._must_go_home = not trip.is_good and self._arm in params.home
        return trip

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that the poses depend on."""
        return {"numpy": np.__version__, "pinocchio": installed_version("pin")}


def _pose(position: Point, orientation: Quaternion) -> Any:
    return pin.SE3(pin.Quaternion(np.array(orientation)).matrix(), np.array(position))


def _events(port: str, log: Sequence[LogEntry]) -> dict[str, Message]:
    """Return the log as one message, a line per entry."""
    if not log:
        return {}
    text = "\n".join(text for _, text in log)
    is_well = all(is_well for is_well, _ in log)
    return {port: Event(level="info" if is_well else "warning", text=text)}
