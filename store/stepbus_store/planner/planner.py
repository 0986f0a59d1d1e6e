"""The planner as a participant: its robot and limits, and one request after the other."""

import math
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_participant import Config, Ports, Step, installed_version
from stepbus_schemas import (
    BaseState,
    Description,
    Event,
    LaserScan,
    Message,
    Plan,
    PlanRequest,
    Point,
    Poses,
    WiringError,
)
from stepbus_store.cause import Cause
from stepbus_store.memory import Remembering
from stepbus_store.planner.base_path import BasePlanner
from stepbus_store.planner.lidar_view import LidarView, RouteMonitor
from stepbus_store.planner.obstacles import Obstacles, PlannedRobot
from stepbus_store.planner.outline import Outline
from stepbus_store.planner.params import Params
from stepbus_store.planner.path_monitor import PathMonitor
from stepbus_store.planner.planning import PathPlanner, is_check, on_floor
from stepbus_store.planner.scene import Margins
from stepbus_store.planner.timing import Limits
from stepbus_store.planner.walkers import Walkers

_EFFORT_SHARE = 0.8
"""Of the URDF's effort limits; the rest is for following the plan."""

_LONGEST_SAMPLE_NS = 20_000_000

_TUCKED = 0.5
"""How far the tip of an arm may be from the axis of a base that gives way [m]."""


@dataclass(frozen=True, kw_only=True)
class _Pending:
    """A request in progress; due: step at which to answer it."""

    due: int
    cancelled: threading.Event
    answer: Future[Plan | None]
    request: PlanRequest
    poses: Poses | None


class Planner(Remembering):
    """Plans collision-free paths of a robot's joints.

    Inputs: one PlanRequest/1, and one Poses/1 of all links of the world, which the sender
    describes with `details` `shape` and `body`; if there are two, the one called `planogram`
    provides the description and the other one the poses; any number of LaserScan/1 from lidars on
    the base, together with one BaseState/1, odometry. Outputs: one Plan/1 and, optionally, one
    Event/1 that reports every answer.

    The answer to a request comes exactly `latency` later, however long the computation takes: it
    runs in parallel with the steps, and the step of the answer waits for it. A newer request
    cancels the previous one. Planning uses the poses at the step of the request. If an object
    blocks the path while the robot follows it, or a lidar sees an obstacle on the route of the
    base, a second answer with the same id has cause `blocked`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._request_port = ports.input_of("PlanRequest/1")
        self._poses_port, self._map_port = ports.input_beside("Poses/1", "planogram")
        self._odometry_port = ports.optional_input_of("BaseState/1")
        self._scan_ports = [n for n, port in config.inputs.items() if port.type == "LaserScan/1"]
        if self._scan_ports and self._odometry_port is None:
            text = "a lidar needs the odometry too: add an input of type BaseState/1"
            ports.problems.add(("inputs",), text)
        self._plan_port = ports.output_of("Plan/1")
        self._event_port = ports.optional_output_of("Event/1")
        ports.outputs_are("Plan/1", "Event/1")
        params = self._params = config.read(Params, ports.problems)
        files = (params.model, params.joints, params.posture, params.srdf)
        links, problems = (params.frame, params.tip), config.problems().below(("params",))
        robot = problems.attempt(("model",), lambda: PlannedRobot(*files, links))
        if robot is None:
            raise problems.error()
        self._robot = robot
        self._limits = Limits(
            velocity=np.minimum(params.velocity_limit.of(robot.joints), robot.velocity_limit),
            acceleration=np.array(params.acceleration_limit.of(robot.joints)),
            jerk=np.array(params.jerk_limit.of(robot.joints)),
            effort=_EFFORT_SHARE * robot.effort_limit,
        )
        period_ns = config.every * config.step_ns
        # Whole steps, if they are below 20 ms.
        steps = max(_LONGEST_SAMPLE_NS // period_ns, 1)
        self._sample = steps * min(period_ns, _LONGEST_SAMPLE_NS) * 1e-9
        self._names = [params.prefix + joint for joint in self._robot.joints]
        self._latency = -(-params.latency_ns // period_ns) * config.every
        self._check_latency = -(-params.check_latency_ns // period_ns) * config.every
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planner")
        self._pending: _Pending | None = None
        self._monitor: PathMonitor | None = None
        self._request_id = -1
        self._map: Any = None
        self._route: RouteMonitor | None = None
        self._next_route: RouteMonitor | None = None
        self._mapped: Sequence[Outline] | None = None
        self._seen = Walkers()
        self._last_poses: Poses | None = None
        self._moving: frozenset[str] = frozenset()

    def describe(self) -> Mapping[str, Description]:
        """Return the joints in the order of the plans, and their limits."""
        robot, limits = self._robot, self._limits
        rows = {"lower": robot.lower, "upper": robot.upper, "velocity": limits.velocity}
        limits_of = {name: row.tolist() for name, row in rows.items()}
        return {self._plan_port: Description(names=self._names, limits=limits_of)}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Read the shapes of the obstacles.

        Raises WiringError if they are not described, and for requests for other joints.
        """
        params, requested = self._params, inputs[self._request_port].names
        if requested and requested != self._names:
            text = f"input {self._request_port!r} has joints {', '.join(requested)}"
            raise WiringError(f"{text}, params.joints are {', '.join(self._names)}")
        described, frame = inputs[self._map_port], params.prefix + params.frame
        obstacles = Obstacles(self._map_port, described, frame, params.prefix)
        self.planner = PathPlanner(
            robot=self._robot,
            obstacles=obstacles,
            tip=params.tip,
            margins=Margins(robot=params.margin),
            limits=self._limits,
            max_checks=params.max_checks,
            period=self._sample,
            seed=self.config.seed,
        )
        self._base_planner = BasePlanner(obstacles, params)
        self._obstacles = obstacles
        self._view = LidarView({port: self._mount(port, inputs[port]) for port in self._scan_ports})
        self._unknown = obstacles.unknown
        self.remember(obstacles)

    def save(self) -> bytes | None:
        """Return the state; None while a request is in progress."""
        return None if self._pending is not None else super().save()

    def _mount(self, port: str, described: Description) -> Point:
        """Return where a lidar is in the base: x, y, yaw [m, rad]."""
        (name,) = described.names or ("",)
        link = name.removeprefix(self._params.prefix)
        robot = self._robot
        if link not in robot.links:
            text = f"input {port!r} belongs to link {name!r}"
            raise WiringError(f"{text}, which is not a link of the robot")
        pose = robot.frame_pose(np.zeros(len(robot.joints)), link)
        x, y, _ = pose.translation.tolist()
        return x, y, math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])

    def update(self, step: Step) -> Mapping[str, Message]:
        """Start a new request, and return the answer that is due."""
        messages: dict[str, Message] = {}
        if self._unknown:
            links = ", ".join(self._unknown)
            self._report(
                messages, f"the shape of {links} is unknown; paths may touch them", warns=True
            )
            self._unknown = []
        if step.is_new(self._poses_port):
            poses = step.read(self._poses_port, Poses)
            self._obstacles.check(poses)
            self._moving = self._obstacles.moving(self._last_poses or poses, poses)
            self._last_poses = poses
        request = step.get(self._request_port, PlanRequest)
        if request is not None and request.id != self._request_id:
            self._start_planning(step, request)
        self._look(step)
        if self._pending is not None and step.index >= self._pending.due:
            self._finish(messages, self._pending, step)
        elif self._monitor is not None and step.is_new(self._poses_port):
            self._check_path(messages, self._monitor, step)
        is_seen = self._plan_port not in messages and any(map(step.is_new, self._scan_ports))
        if self._route is not None and is_seen:
            self._check_route(messages, self._route, step)
        return messages

    def _start_planning(self, step: Step, request: PlanRequest) -> None:
        self._cancel(request)
        self._request_id = request.id
        cancelled = threading.Event()
        poses = step.get(self._poses_port, Poses)
        is_quick = request.base is not None or is_check(request)
        answer: Future[Plan | None]
        if request.base is not None and poses is not None:
            # The frame in which the base is at the start of the request.
            self._map = self._obstacles.frame_in_world(poses) * on_floor(request.base[0]).inverse()
            mapped = self._base_planner.mapped(request, poses)
            # What moves may be gone a moment later.
            self._mapped = [thing for thing in mapped if thing.link not in self._moving]
            if self._scan_ports:
                self._seen.look(self._view.things(self._mapped), step.t)
            else:
                self._seen.pausing = [thing for thing in mapped if thing.link in self._moving]
            reach = self._obstacles.reach(poses, self._params.tip)
            # The worker sees what is seen now, however long it takes.
            answer = self._worker.submit(
                self._plan_route, request, self._mapped, self._seen.snapshot(), reach
            )
        else:
            now = self._odometry(step)
            seen = None if now is None else ((now.x, now.y, now.yaw), self._seen.all())
            answer = self._worker.submit(
                self.planner.plan, request, poses, cancelled.is_set, self._map, seen
            )
        self._pending = _Pending(
            due=step.index + (self._check_latency if is_quick else self._latency),
            cancelled=cancelled,
            answer=answer,
            request=request,
            poses=poses,
        )

    def _plan_route(
        self, request: PlanRequest, mapped: Sequence[Outline], seen: Walkers, reach: float
    ) -> Plan:
        """Plan around what the map has, and what the lidars see; watch that from then on.

        reach: of the arm from the axis of the base [m].
        """
        plan = self._base_planner.plan(request, mapped, seen, may_give_way=reach < _TUCKED)
        self._next_route = None
        if self._scan_ports and plan.route and request.base is not None:
            route, known = [request.base[0], *plan.route], [*seen.standing, *seen.pausing]
            self._next_route = RouteMonitor(request.id, route, known, self._params)
        return plan

    def _odometry(self, step: Step) -> BaseState | None:
        return step.get(self._odometry_port, BaseState) if self._odometry_port else None

    def _look(self, step: Step) -> None:
        """Take what the lidars see."""
        base, ports = self._odometry(step), list(filter(step.is_new, self._scan_ports))
        if base is None or not ports:
            return
        for port in ports:
            self._view.take(port, step.read(port, LaserScan), base)
        if self._mapped is not None:
            self._seen.look(self._view.things(self._mapped), step.t)

    def _check_route(self, messages: dict[str, Message], route: RouteMonitor, step: Step) -> None:
        """Report something that comes into the way of the base."""
        text = route.check(self._seen, step.read(self._odometry_port or "", BaseState))
        if not text and route.is_needless(self._view):
            text = "what it drives around has gone"
        if text:
            self._route = None
            self._publish(messages, Plan(id=route.request_id, cause=Cause.BLOCKED, text=text))

    def _finish(self, messages: dict[str, Message], pending: _Pending, step: Step) -> None:
        plan, request, poses = pending.answer.result(), pending.request, pending.poses
        self._pending = None
        if request.base is not None:
            self._route, self._next_route = self._next_route, None
        if plan is None:
            return
        self._publish(messages, plan)
        if not plan.cause and not plan.route and poses is not None:
            self._monitor = PathMonitor(
                self.planner, request, plan, poses, t=step.t, map_in_world=self._map
            )

    def _check_path(self, messages: dict[str, Message], monitor: PathMonitor, step: Step) -> None:
        """Report an object that blocks the path in use."""
        text = monitor.check(step.read(self._poses_port, Poses), step.t)
        if text:
            self._publish(messages, Plan(id=monitor.request.id, cause=Cause.BLOCKED, text=text))
        if text or monitor.is_over:
            self._monitor = None

    def _publish(self, messages: dict[str, Message], plan: Plan) -> None:
        messages[self._plan_port] = plan
        self._report(messages, f"plan {plan.id}: {plan.text}", warns=bool(plan.cause))

    def _report(self, messages: dict[str, Message], text: str, *, warns: bool) -> None:
        if self._event_port is not None:
            messages[self._event_port] = Event(level="warning" if warns else "info", text=text)

    def _cancel(self, request: PlanRequest | None = None) -> None:
        if request is None or request.base is None:
            # A route of the base changes nothing about the path of an arm.
            self._monitor = None
        if self._pending is not None:
            self._pending.cancelled.set()
            self._pending = None

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the plans."""
        return {
            name: installed_version(name) for name in ("numpy", "pin", "coal", "ompl", "toppra")
        }

    def close(self) -> None:
        """Cancel the request in progress."""
        self._cancel()
        self._worker.shutdown(wait=True, cancel_futures=True)
        super().close()
