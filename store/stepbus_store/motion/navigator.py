"""Drives a base along a path: where it should be, how far it is off, and how fast it may go."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from msgspec.structs import replace

from stepbus_schemas import BaseState, Goal, Plan, PlanRequest, Point
from stepbus_store.cause import Cause
from stepbus_store.motion.base_motion import BaseMotion
from stepbus_store.motion.outcome import Outcome, Refused
from stepbus_store.motion.route import base_route, first_part

_A_MOMENT = 0.3
"""How long the base waits for what is in its way, until it asks for a way around that [s]."""

_PATIENCE = 20.0
"""How long it waits where there is no way around [s]."""

_LONGER = (1.05, 0.05)
"""A route leads around something where it is longer than that share of the straight line, and by
that more [m]."""

REPLANS = 3
"""How often a goal may get another route of the base, or path of the arm."""


@dataclass(kw_only=True)
class _Trip:
    """A goal that needs a route; asked_at: when the newest request was made, None: not yet [s].

    start: where the base stood then.
    hindered_at: since when something is in the way that may go away, None: nothing is [s].
    not_before: when the next request may be made [s].
    """

    goal: Goal
    held: str
    number: int = -1
    asked_at: float | None = None
    start: Point | None = None
    drives: bool = False
    replans: int = 0
    route: list[Point] | None = None
    is_cut: bool = False
    alone_since: float | None = None
    hindered_at: float | None = None
    not_before: float = 0.0


class Navigator:
    """Lets a base drive to a pose along a planner's route; one goal at a time.

    next_id: makes the ids of requests, which the arm's share. timeout: for an answer [s].
    step: after which the base stops and asks for the rest of its route anew, unless it goes
    together with the arm; 0: it does not [m].
    """

    def __init__(
        self, base: BaseMotion, next_id: Callable[[], int], timeout: float, step: float
    ) -> None:
        self._step = step
        self._base = base
        self._next_id = next_id
        self._timeout = timeout
        self._trip: _Trip | None = None
        self._unsent: PlanRequest | None = None
        self._verdict: Outcome | None = None
        self.waits = False
        """Whether the base stays where it is until the arm may move."""
        self.is_accompanied = False
        """Whether the goal of the arm has come that the base waits for."""
        self.hindrance = ""
        """What has come into the way of the base; empty: nothing."""
        self._occupied = ""
        self.may_detour = True
        """Whether no arm has reached out for the end of the route."""

    @property
    def is_detour(self) -> bool:
        """Return whether the route leads around something."""
        trip = self._trip
        if trip is None or trip.route is None or trip.start is None:
            return False
        places = [trip.start, *trip.route]
        length = sum(math.dist(a[:2], b[:2]) for a, b in pairwise(places))
        share, more = _LONGER
        return length > share * math.dist(places[0][:2], places[-1][:2]) + more

    @property
    def has_route(self) -> bool:
        """Return whether it is known where the base goes."""
        trip = self._trip
        return trip is None or trip.drives or trip.route is not None

    @property
    def drives(self) -> bool:
        """Return whether the base follows a route to its goal."""
        return self._trip is not None and self._trip.drives

    def ahead(self) -> list[tuple[float, Point]]:
        """Return poses along the route, and how far each is from its end [m]."""
        trip = self._trip
        if trip is None or trip.drives or trip.route is None:
            return self._base.ahead()
        state, position = self._base.state, self._base.position
        return self._base.ahead(base_route(trip.goal, state, position, trip.route).segments)

    def go(self) -> None:
        """Wait no longer, and drive the route that is known."""
        self.waits = False
        trip = self._trip
        if trip is not None and trip.route is not None and not trip.drives:
            self._drive(trip, trip.route)

    def pause(self) -> None:
        """Stop, and wait with the rest of the route until the arm has moved."""
        self.waits, trip = True, self._trip
        if trip is not None and trip.drives and not self._base.is_halting:
            trip.drives, trip.asked_at, trip.route = False, None, None
            self._base.stop()

    def wait_again(self) -> None:
        """Wait for another goal of the arm, as long as for the first one."""
        self.is_accompanied = False
        if self._trip is not None:
            self._trip.alone_since = None

    def start(self, goal: Goal, held: str, t: float, state: BaseState) -> str:
        """Start a go_to or go_together at a time [s]; raises Refused for one without sense."""
        text = self._base.check_goal(goal, state)
        self.cancel()
        self._base.stop()
        self._trip = _Trip(goal=goal, held=held)
        self.waits, self.may_detour = goal.type == "go_together", True
        self.is_accompanied = False
        self._ask(self._trip, t)
        return text

    def cancel(self) -> None:
        """Forget the goal."""
        self._trip, self._unsent, self._verdict, self.waits = None, None, None, False
        self.hindrance = self._occupied = ""

    @property
    def awaits_route(self) -> bool:
        """Return whether the planner has been asked, and has not answered yet."""
        trip = self._trip
        is_asked = trip is not None and trip.asked_at is not None and self._unsent is None
        return is_asked and trip is not None and trip.route is None and self._verdict is None

    def pop(self) -> PlanRequest | None:
        """Return what to ask the planner, once."""
        request, self._unsent = self._unsent, None
        return request

    def take_plan(self, plan: Plan) -> None:
        """Follow a route, or fail the goal that has none; other answers are ignored."""
        trip = self._trip
        if trip is None or plan.id != trip.number:
            return
        if trip.drives:
            self.hindrance = plan.text if plan.cause == Cause.BLOCKED else ""
            return
        if plan.cause in (Cause.OCCUPIED, Cause.BLOCKED):
            # Blocked: it has not driven off yet.
            self._occupied = plan.text
            return
        if plan.cause:
            self._verdict = Outcome(state="failed", cause=Cause.NO_PATH, text=plan.text)
            return
        trip.route = plan.route
        if self.is_detour and not self.may_detour:
            text = f"the way leads around something, but the arm is out: {plan.text}"
            self._verdict = Outcome(state="failed", cause=Cause.BLOCKED, text=text)
        elif not self.waits:
            self._drive(trip, plan.route)

    def _drive(self, trip: _Trip, route: list[Point]) -> None:
        state = self._base.state
        # The arm beside it counts on the whole route.
        steps = self._step > 0.0 and trip.goal.type != "go_together"
        cut = first_part((state.x, state.y, state.yaw), route, self._step) if steps else None
        trip.is_cut = cut is not None
        goal = trip.goal if cut is None else replace(trip.goal, base=cut[-1])
        try:
            self._base.start(goal, state, cut or route)
        except Refused as exc:
            self._verdict = Outcome(state="failed", cause=exc.cause, text=str(exc))
            return
        trip.drives = True
        trip.hindered_at = None

    @property
    def is_held_up(self) -> bool:
        """Return whether the base stands, or comes to rest, for something in its way."""
        return self._trip is not None and self._trip.hindered_at is not None

    def give_way(self, t: float) -> str:
        """Stop for what has come into the way, and go on once there is a route; return a sentence.

        It may be gone a moment later: the base waits before it looks for a way around it.
        """
        why, self.hindrance, trip = self.hindrance, "", self._trip
        if trip is None or not trip.drives:
            return ""
        trip.drives, trip.asked_at, trip.route = False, None, None
        trip.hindered_at = t if trip.hindered_at is None else trip.hindered_at
        self._base.stop()
        return f"{why}; stops, and goes on when there is a way"

    def replan(self, why: str) -> str:
        """Ask for another route once the base stands; return a sentence, or nothing: no more."""
        trip = self._trip
        if trip is None or trip.replans >= REPLANS:
            return ""
        trip.replans += 1
        trip.drives, trip.asked_at, trip.route = False, None, None
        return f"{why}; asked for another route ({trip.replans} of {REPLANS})"

    def check(self, end: Outcome | None, t: float) -> Outcome | None:
        """Return how the goal ended at a time [s]; end: of the base's motion."""
        trip = self._trip
        if trip is not None and trip.drives and trip.is_cut and end and end.state == "succeeded":
            trip.drives, trip.asked_at, trip.route = False, None, None
            return None
        if trip is None or trip.drives:
            return end
        if self._occupied:
            text, self._occupied = self._occupied, ""
            trip.hindered_at = t if trip.hindered_at is None else trip.hindered_at
            if t - trip.hindered_at > _PATIENCE:
                text = f"{text}; it has been in the way for {_PATIENCE:g} s"
                return Outcome(state="failed", cause=Cause.NO_PATH, text=text)
            trip.asked_at, trip.route, trip.not_before = None, None, t + _A_MOMENT
        if self._verdict is not None:
            verdict, self._verdict = self._verdict, None
            return verdict
        if trip.asked_at is None:
            if not self._base.is_moving and t >= trip.not_before:
                self._ask(trip, t)
        elif trip.route is None and t - trip.asked_at > self._timeout:
            text = f"the planner has not answered for {self._timeout:g} s; is it running?"
            return Outcome(state="failed", cause=Cause.NO_PLAN, text=text)
        return self._wait(trip, t)

    def _wait(self, trip: _Trip, t: float) -> Outcome | None:
        """Return a failure where no goal of the arm has come, or come again, for too long."""
        if not self.waits or self.is_accompanied or trip.route is None:
            trip.alone_since = None
            return None
        if trip.alone_since is None:
            trip.alone_since = t
        if t - trip.alone_since <= self._timeout:
            return None
        text = f"no goal of the arm has come for {self._timeout:g} s"
        return Outcome(state="failed", cause=Cause.INVALID, text=text)

    def _ask(self, trip: _Trip, t: float) -> None:
        now, goal = self._base.state, trip.goal
        if self._base.is_moving or goal.base is None:
            return
        trip.number, trip.asked_at, trip.start = self._next_id(), t, (now.x, now.y, now.yaw)
        self._unsent = PlanRequest(
            id=trip.number,
            start=[],
            goal=[],
            held=trip.held,
            touches=list(goal.touches),
            base=(trip.start, goal.base),
        )
