"""The planner as a participant: answers a request a fixed time later."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from typing import Literal

from stepbus_participant import Config, Participant, Step
from stepbus_participant.settings import Settings
from stepbus_schemas import Description, Event, Message, Plan, PlanRequest, Poses, WiringError

from . import search, timing
from .libraries import need
from .obstacles import World
from .params import read_params
from .path_monitor import Way, WayWatch, last_step
from .planning import WayPlanner

Level = Literal["info", "warning"]


@dataclass(frozen=True, kw_only=True)
class _Pending:
    """A request that is being worked on; due: step at which it is answered."""

    due: int
    cancelled: threading.Event
    answer: Future[Plan | None]
    request: PlanRequest
    poses: Poses | None


class PlannerParticipant(Participant):
    """Finds ways of a robot's joints that touch nothing.

    Inputs: one PlanRequest/1, and one Poses/1 of all links of the world, which the sender
    describes with `details` `shape` and `body`. Outputs: one Plan/1 and, where the scenario wires
    it, one Event/1 that tells of every answer.

    A request that is new at a step is answered exactly `latency` later, however long the work
    takes: it is done beside the steps, and the step of the answer waits for it. A newer request
    cancels the one before. The world stands still at the poses of the request's step; when
    something then moves into the way while the robot goes it, a second answer of the same id says
    so, with cause `blocked`.

    Parameters: model: URDF or xacro. joints: those to plan for, in the order of the requests.
    posture: map from other joints to where they stand, neutral otherwise [rad or m]. srdf: pairs
    of links that never or always touch; without it the neighbours and those that touch in that
    posture. frame (`chassis`): link by which the robot is found among the poses; it has to be
    the root of the URDF. tip (`grasp`): frame that held things move with. margin (0.01): how
    close the robot may come to anything, held_margin (0.003): the same of held things [m].
    velocity_limit (1.5), acceleration_limit (3.0): one number for all joints, a list, or a map
    by name [rad/s, rad/s²]. max_checks (20000): positions that a search looks at. latency
    (200ms): rounded up to a multiple of the planner's own period.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        settings = Settings(config)
        self._request_port = settings.input_of("PlanRequest/1")
        self._poses_port = settings.input_of("Poses/1")
        self._plan_port = settings.output_of("Plan/1")
        self._event_port = settings.optional_output_of("Event/1")
        settings.outputs_are("Plan/1", "Event/1")
        try:
            need(*search.MODULES, *timing.MODULES)
        except WiringError as exc:
            raise WiringError(f"participants.{config.name}: {exc}") from exc
        self._params = read_params(settings)
        period_ns = config.every * config.step_ns
        self._latency = -(-self._params.latency_ns // period_ns) * config.every
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planner")
        self._pending: _Pending | None = None
        self._watch: WayWatch | None = None
        self._request_id = -1
        self._news: list[str] = []

    def describe(self) -> Mapping[str, Description]:
        """Return the joints in the order of the plans, and their limits."""
        robot, limits = self._params.robot, self._params.task.limits
        described = {
            self._plan_port: Description(
                names=list(robot.joints),
                limits={
                    "lower": robot.lower.tolist(),
                    "upper": robot.upper.tolist(),
                    "velocity": limits.velocity.tolist(),
                },
            )
        }
        if self._event_port is not None:
            described[self._event_port] = Description()
        return described

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Take in the shapes of the world.

        Raises WiringError where they are not described, or where requests are of other joints.
        """
        params, asked = self._params, inputs[self._request_port].names
        if asked and tuple(asked) != params.robot.joints:
            raise WiringError(
                f"{self.config.name}: input {self._request_port!r} is of joints "
                f"{', '.join(asked)}, params.joints are {', '.join(params.robot.joints)}"
            )
        try:
            world = World(self._poses_port, inputs[self._poses_port], params.frame)
        except WiringError as exc:
            lines = [f"{self.config.name}: {line}" for line in str(exc).splitlines()]
            raise WiringError("\n".join(lines)) from exc
        self._planner = WayPlanner(params.robot, world, params.task, self.config.seed)
        self._world = world
        if world.unseen:
            self._news.append(
                f"nothing is known of the shape of {', '.join(world.unseen)}; ways may touch them"
            )

    def update(self, step: Step) -> Mapping[str, Message]:
        """Take in a new request, and return the answer that is due."""
        messages: dict[str, Message] = {}
        if self._news:
            self._tell(messages, "warning", "; ".join(self._news))
            self._news = []
        if step.is_new(self._poses_port):
            self._world.check(step.read(self._poses_port, Poses))
        request = step.get(self._request_port, PlanRequest)
        if request is not None and request.id != self._request_id:
            self._begin(step, request)
        if self._pending is not None and step.index >= self._pending.due:
            self._finish(messages, self._pending, step)
        elif self._watch is not None and step.is_new(self._poses_port):
            self._look(messages, self._watch, step)
        return messages

    def _begin(self, step: Step, request: PlanRequest) -> None:
        self._cancel()
        self._request_id = request.id
        cancelled = threading.Event()
        poses = step.get(self._poses_port, Poses)
        answer = self._worker.submit(self._planner.plan, request, poses, cancelled.is_set)
        self._pending = _Pending(
            due=step.index + self._latency,
            cancelled=cancelled,
            answer=answer,
            request=request,
            poses=poses,
        )

    def _finish(self, messages: dict[str, Message], pending: _Pending, step: Step) -> None:
        plan = pending.answer.result()
        self._pending = None
        if plan is not None:
            self._publish(messages, plan)
            if not plan.cause and pending.poses is not None:
                last = last_step(plan, step.index, self.config.step_ns * 1e-9)
                way = Way(request=pending.request, plan=plan, poses=pending.poses, last_step=last)
                self._watch = WayWatch(self._params.robot, self._world, self._params.task, way)

    def _look(self, messages: dict[str, Message], watch: WayWatch, step: Step) -> None:
        """Say so where something has come into the way that is being gone."""
        text = watch.look(step.read(self._poses_port, Poses), step.index)
        if text:
            self._publish(messages, Plan(id=self._request_id, cause="blocked", text=text))
        if text or watch.is_over:
            self._watch = None

    def _publish(self, messages: dict[str, Message], plan: Plan) -> None:
        messages[self._plan_port] = plan
        level: Level = "warning" if plan.cause else "info"
        self._tell(messages, level, f"plan {plan.id}: {plan.text}")

    def _tell(self, messages: dict[str, Message], level: Level, text: str) -> None:
        if self._event_port is not None:
            messages[self._event_port] = Event(level=level, text=text)

    def _cancel(self) -> None:
        self._watch = None
        if self._pending is not None:
            self._pending.cancelled.set()
            self._pending = None

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the plans."""
        return {name: version(name) for name in ("numpy", "pin", "coal", "ompl", "toppra")}

    def close(self) -> None:
        """Give up what is being worked on."""
        self._cancel()
        self._worker.shutdown(wait=True, cancel_futures=True)
