"""Sell goods: fetch what was ordered from the shelves and put it into the outlet.

Run as `python -m stepbus_mission.store`. What follows on what stands in `store_table.py`, what a
state asks of the controller in `store_goals.py`, when it is over in `store_checks.py` and
`store_looking.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from stepbus_participant.config import Config
from stepbus_participant.participant import Participant
from stepbus_participant.settings import Settings, nearest
from stepbus_participant.step import Step
from stepbus_schemas import (
    BaseState,
    Description,
    Detections,
    Event,
    Goal,
    GoalStatus,
    GripperState,
    Message,
    Poses,
    RunError,
    WiringError,
)

from .checks import check_of
from .goals import GOALS
from .reading import read_ports, read_settings
from .report import summary
from .sale import Level, Outcome, Seen, Shop, Told, Visit
from .settings import StoreSettings
from .stock import Stock
from .table import FIRST, LAST, TABLE

_LEVELS: Sequence[Level] = ("info", "warning", "error")


class StoreMission(Participant):
    """Carries out one order after the other; any failure is an emergency stop and fails the run.

    Inputs: Poses/1, the truth of the plant, for the stock-taking at the first step and for the
    checks at the end of each sale; Detections/1, GripperState/1, BaseState/1 and GoalStatus/1.
    Outputs: Goal/1, and Event/1 with what happens; an output of type Event/1 with the name
    `summary` gets the report. The parameters are those of `store_settings.StoreSettings`, as
    `docs/store_mission.md` lists them.

    Raises RunError, at the step after the last event, where a sale has failed.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        settings = Settings(config)
        self._ports = read_ports(settings, config)
        self._settings = read_settings(settings)
        settings.check()
        self._goals = 0
        self._failure = ""
        self._is_done = False
        self._shop: Shop | None = None

    def describe(self) -> Mapping[str, Description]:
        """Return that nothing here has names."""
        ports = (self._ports.goal, self._ports.events, self._ports.summary)
        return dict.fromkeys(ports, Description())

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Learn what there is to sell; refuse orders of items that are not there."""
        description = inputs[self._ports.poses]
        stock = Stock(description, list(self._settings.shelves))
        problems = _unknown(self._settings, stock, description.names)
        if problems:
            where = f"participants.{self.config.name}.params"
            raise WiringError("\n".join(f"{where}.{problem}" for problem in problems))
        self._stock = stock

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the next goal, where the state has changed, and what there is to say."""
        if self._failure:
            raise RunError(self._failure)
        if self._is_done:
            return {}
        shop = self._look(step)
        goal = self._go_on(shop)
        messages: dict[str, Message] = {} if goal is None else {self._ports.goal: goal}
        if shop.visit.state in LAST:
            self._end(step, shop)
        return messages | self._events(shop)

    def _look(self, step: Step) -> Shop:
        """Return all that is known at this step; at the first one, take stock."""
        seen = self._see(step)
        self._stock.check(seen.poses)
        if self._shop is None:
            self._stock.take(seen.poses)
            visit = Visit(state=FIRST, began_ns=step.t_ns)
            self._shop = Shop(settings=self._settings, stock=self._stock, visit=visit, seen=seen)
        self._shop.seen = seen
        return self._shop

    def _see(self, step: Step) -> Seen:
        """Return what there is to be seen at this step."""
        ports = self._ports
        status = step.get(ports.status, GoalStatus)
        is_newest = status is not None and status.id == self._goals - 1
        fresh = step.is_new(ports.detections)
        return Seen(
            t_ns=step.t_ns,
            poses=step.read(ports.poses, Poses),
            odometry=step.read(ports.odometry, BaseState),
            hand=step.read(ports.hand, GripperState),
            status=status if is_newest else None,
            detections=step.get(ports.detections, Detections) if fresh else None,
        )

    def _go_on(self, shop: Shop) -> Goal | None:
        """Pass from state to state until one has to wait; return the goal that it sends."""
        while True:
            outcome = check_of(shop.visit.state)(shop)
            if outcome is None:
                return None
            goal = self._enter(shop, outcome)
            if goal is not None or shop.visit.state in LAST:
                return goal

    def _enter(self, shop: Shop, outcome: Outcome) -> Goal | None:
        """Pass to the next state; return its goal, if it has one."""
        state = TABLE[shop.visit.state].then[outcome.word]
        if state in {"retry", "stop"}:
            shop.note(outcome)
        maker = GOALS.get(state)
        shop.visit = Visit(state=state, began_ns=shop.seen.t_ns)
        if maker is None:
            return None
        goal = msgspec.structs.replace(maker(shop), id=self._goals)
        self._goals += 1
        shop.visit.goal, shop.visit.kind = goal.id, goal.type
        return goal

    def _end(self, step: Step, shop: Shop) -> None:
        """End the run: now, or by an error once the last event is out."""
        self._is_done = True
        if shop.visit.state == "failed":
            self._failure = shop.failure()
            shop.told.append(("error", self._failure))
        else:
            count = len(shop.rows)
            step.end(f"{self.config.name}: {count} of {count} sales are done")

    def _events(self, shop: Shop) -> dict[str, Message]:
        """Return what there is to say at this step, and at the end the report."""
        told, shop.told = shop.told, []
        ports = self._ports
        report = self._report(shop) if self._is_done else []
        if ports.summary == ports.events:
            return _event(ports.events, [*told, *report])
        return _event(ports.events, told) | _event(ports.summary, report)

    def _report(self, shop: Shop) -> list[Told]:
        text = summary(shop.rows, len(self._settings.orders), shop.since(0), failure=self._failure)
        return [("info", text)]


def _event(port: str, told: Sequence[Told]) -> dict[str, Message]:
    """Return what is told as one message, a line each, as serious as its worst line."""
    if not told:
        return {}
    level = max((level for level, _ in told), key=_LEVELS.index)
    return {port: Event(level=level, text="\n".join(text for _, text in told))}


def _unknown(settings: StoreSettings, stock: Stock, links: Sequence[str]) -> list[str]:
    """Return what the scenario names and the plant does not have."""
    problems = [
        f"orders: there is no item {order.item!r}; {nearest(order.item, stock.names)}"
        for order in settings.orders
        if order.item and order.item not in stock.names
    ]
    link = settings.outlet.link
    if link not in links:
        problems.append(f"outlet.link: the plant has no link {link!r}; {nearest(link, links)}")
    return problems
