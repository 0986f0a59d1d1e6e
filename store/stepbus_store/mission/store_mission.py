"""Sells items: fetches each order from the shelves and puts it into the outlet.

`state_table.py` has the table of states, `state_goals.py` the goal of each state, `checks.py` and
`verification.py` decide when a state ends.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import msgspec

from stepbus_participant import CallError, Config, Method, Ports, SettingsError, Step, suggest
from stepbus_schemas import (
    BaseState,
    CameraTrigger,
    Contacts,
    Description,
    Detections,
    EmergencyStop,
    Event,
    Goal,
    GoalStatus,
    GripperState,
    Imu,
    Message,
    Poses,
    RunError,
    WiringError,
)
from stepbus_store.cause import Cause
from stepbus_store.memory import Remembering
from stepbus_store.mission.checks import CHECKS, CURABLE, PLANNABLE, arrived
from stepbus_store.mission.geometry import TrueBase
from stepbus_store.mission.inventory import Stock
from stepbus_store.mission.params import Params, unknown_type
from stepbus_store.mission.report import WITNESSES, summary
from stepbus_store.mission.rest import Interruption, overturned
from stepbus_store.mission.state import ASIDES, Inputs, Level, LogEntry, Outcome, StoreState, Visit
from stepbus_store.mission.state_goals import GOALS
from stepbus_store.mission.state_table import FIRST, LAST, STATES, TRIPS
from stepbus_store.mission.verification import looked_at, wants_image
from stepbus_store.mission.witness import Blows, Witness
from stepbus_store.poses import check_poses

_WITHDRAWALS = 3
"""How often in a sale the base goes on without the arm beside it."""

_LEVELS: Sequence[Level] = ("info", "warning", "error")


class _PortNames:
    """Names of the ports; summary may be the same as events. Problems are added to `ports`."""

    def __init__(self, ports: Ports) -> None:
        self.events, self.summary = ports.event_outputs()
        ports.outputs_are("Goal/1", "Event/1", "CameraTrigger/1")
        self.poses, self.planogram = ports.input_beside("Poses/1", "planogram")
        self.odometry, self.pose = ports.input_beside("BaseState/1", "pose")
        self.detections = ports.input_of("Detections/1")
        self.gripper = ports.input_of("GripperState/1")
        self.status = ports.input_of("GoalStatus/1")
        self.contacts = ports.optional_input_of("Contacts/1")
        self.stop = ports.optional_input_of("EmergencyStop/1")
        self.imu = ports.optional_input_of("Imu/1")
        self.camera = ports.optional_output_of("CameraTrigger/1")
        self.goal = ports.output_of("Goal/1")


class StoreMission(Remembering):
    """Fulfils one order after the other; any failure triggers an emergency stop and fails the run.

    Inputs: Poses/1, the known poses of the items: true ones from the plant, or those of a world
    model, together with its planogram; used for the inventory at the first step and, with
    `verification: truth`, to verify each sale; Detections/1, GripperState/1, GoalStatus/1;
    BaseState/1, odometry, and, if odometry drifts, another one called `pose`, the pose of the base
    on the map. Optional inputs: Contacts/1, to distinguish items that the robot moved from items
    that others moved; EmergencyStop/1, during which the mission sends no commands; Imu/1 with the
    orientation of the base, which must not tilt.
    Outputs: Goal/1; CameraTrigger/1, if the camera takes images on request; Event/1 with the log;
    an output of type Event/1 named `summary` carries the report. Parameters: see `Params`;
    `store/docs/mission.md` lists them.

    Raises RunError after a failed sale, at the step after the last event.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._ports = _PortNames(ports)
        self._settings = config.read(Params, ports.problems)
        self._goals = 0
        self._images = 0
        self._further: list[str] = []
        self._statuses: dict[int, GoalStatus] = {}
        self._failure = ""
        self._is_done = False
        self._store: StoreState | None = None
        self._interruption = Interruption()

    def calls(self) -> Mapping[str, Method]:
        """Return the call that orders one more item."""
        order = Method(
            self.order,
            "TYPE: orders one more item, after all other orders; returns the number of orders",
            changes=True,
        )
        return {"order": order}

    def order(self, item_type: str) -> int:
        """Order one more item of a type; raises CallError for one that cannot be sold."""
        if self._is_done or self._failure:
            raise CallError("the mission has ended")
        given = [*self.config.params["orders"], *self._further, item_type]
        params = {**self.config.params, "orders": given}
        try:
            settings = replace(self.config, params=params).read(Params)
        except SettingsError as exc:
            raise CallError(str(exc)) from exc
        if item_type not in self._stock.types:
            raise CallError(unknown_type(item_type, self._stock.types))
        if not settings.is_in_outlet(len(given) - 1, len(given) - 1 - len(self._further)):
            raise CallError(f"the outlet is full: {len(given) - 1} items are ordered")
        self._further.append(item_type)
        self._settings = settings
        if self._store is not None:
            self._store.settings = settings
        return len(given)

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Read the stock from the plant's description.

        Raises WiringError for orders of unknown items, and for an unknown outlet.
        """
        description = inputs[self._ports.planogram]
        stock = Stock(description, list(self._settings.shelves))
        problems = _unknown(self._settings, stock, description.names)
        if problems:
            where = f"participants.{self.config.name}.params"
            raise WiringError("\n".join(f"{where}.{problem}" for problem in problems))
        self._stock, self._links = stock, description.names
        contacts, names = self._ports.contacts, description.names
        self._robot_links = frozenset(inputs[contacts].names if contacts is not None else ())
        self._is_true = self._settings.verification == "truth"
        frame = self._settings.prefix + self._settings.base_frame
        is_known = self._is_true and frame in names
        self._true_base = TrueBase(names.index(frame)) if is_known else None
        self.remember()

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the goal of a new state, and the log entries of this step."""
        if self._failure:
            raise RunError(self._failure)
        if self._is_done:
            return {}
        store = self._observe(step)
        goal = self._advance(store)
        messages: dict[str, Message] = {} if goal is None else {self._ports.goal: goal}
        if store.visit.state in LAST:
            self._end(step, store)
        return messages | self._look(store) | self._events(store)

    def _look(self, store: StoreState) -> dict[str, Message]:
        """Return a request for an image, where one is wanted and the camera waits for requests."""
        port, is_stopped = self._ports.camera, self._interruption.stop is not None
        if port is None or is_stopped or not wants_image(store):
            return {}
        store.visit.asked_ns = store.inputs.t_ns
        self._images += 1
        frame, spot = store.settings.base_frame, looked_at(store)
        return {port: CameraTrigger(id=self._images - 1, frame=frame, position=spot)}

    def _observe(self, step: Step) -> StoreState:
        """Update the state with the inputs of this step; take inventory at the first one."""
        inputs, settings = self._read(step), self._settings
        check_poses(self._ports.poses, self._links, inputs.poses)
        if self._store is None:
            self._stock.take_inventory(inputs.poses)
            self._store = StoreState(
                settings=settings,
                planned=len(settings.orders) - len(self._further),
                stock=self._stock,
                witness=Witness(self._stock, inputs.poses, settings.tolerances.moved)
                if self._is_true
                else None,
                blows=Blows(self._robot_links),
                visit=Visit(state=FIRST, start_ns=step.t_ns),
                inputs=inputs,
            )
        self._store.inputs = inputs
        witness = self._store.witness
        if inputs.contacts is not None:
            self._store.blows.feel(inputs.contacts, step.t)
            if witness is not None:
                witness.feel(inputs.contacts, self._robot_links, step.t)
                if step.is_new(self._ports.poses):
                    self._watch(self._store, witness)
        return self._store

    def _watch(self, store: StoreState, witness: Witness) -> None:
        """Report items that others move."""
        inputs = store.inputs
        sold = store.sale.item.name if store.sale and store.sale.item else ""
        for item, distance in witness.watch(inputs.poses, inputs.t_ns * 1e-9, sold):
            text = f"{item} was moved by {distance * 1e3:.1f} mm, not by the robot"
            store.log.append(("warning", text))

    def _read(self, step: Step) -> Inputs:
        ports = self._ports
        status = step.get(ports.status, GoalStatus)
        if status is not None:
            self._statuses[status.id] = status
        fresh = step.is_new(ports.detections)
        return Inputs(
            t_ns=step.t_ns,
            poses=step.read(ports.poses, Poses),
            odometry=step.read(ports.odometry, BaseState),
            pose=self._pose(step),
            gripper=step.read(ports.gripper, GripperState),
            status=self._statuses.get(self._goals - 1),
            trip=self._statuses.get(self._store.trip) if self._store is not None else None,
            detections=step.get(ports.detections, Detections) if fresh else None,
            contacts=step.get(ports.contacts, Contacts) if ports.contacts else None,
            stop=step.get(ports.stop, EmergencyStop) if ports.stop else None,
            imu=step.get(ports.imu, Imu) if ports.imu else None,
        )

    def _pose(self, step: Step) -> BaseState | None:
        """Return where the base is on the map, or in truth; None: odometry is right."""
        ports = self._ports
        if ports.pose != ports.odometry:
            return step.read(ports.pose, BaseState)
        if self._true_base is None:
            return None
        odometry = step.read(ports.odometry, BaseState)
        if step.is_new(ports.poses):
            self._true_base.see(step.read(ports.poses, Poses), odometry)
        return self._true_base.pose(odometry)

    def _advance(self, store: StoreState) -> Goal | None:
        """Change states until one has to wait; return its goal, if it sends one."""
        again = self._interruption.resumes(store)
        if self._interruption.holds(store):
            return self._send(store, "failed") if self._interruption.is_over else None
        if again:
            return self._send(store, again)
        lost = _lost(store.inputs) or overturned(store)
        if lost is not None and store.visit.state not in ("stop", *LAST):
            store.record_problem(lost)
            return self._send(store, "stop")
        while True:
            outcome = CHECKS.get(store.visit.state, arrived)(store)
            if outcome is None:
                return None
            goal = (
                self._planned_instead(store, outcome)
                or self._elsewhere(store, outcome)
                or self.enter(store, self._withdrawn(store, outcome))
            )
            if goal is not None or store.visit.state in LAST:
                return goal

    def _planned_instead(self, store: StoreState, outcome: Outcome) -> Goal | None:
        """Return the goal of a state that no straight line leads to, along a planned path."""
        visit = store.visit
        is_line = visit.goal_type == "move_linear" and outcome.cause in CURABLE
        if not is_line or visit.state not in PLANNABLE:
            return None
        store.report(f"{outcome.text}; along a planned path instead", "warning")
        return self._send(store, visit.state, is_planned=True)

    def _elsewhere(self, store: StoreState, outcome: Outcome) -> Goal | None:
        """Return the goal to another place before the shelf, or the outlet.

        That is where there is no way to the one so far, or from there none for the arm.
        """
        sale, trip = store.sale, TRIPS.get(store.visit.state)
        served = (*TRIPS.values(), "reach", "arrive", "come_home")
        can_help = outcome.doing or store.visit.state in served
        if sale is None or trip is None or outcome.cause != Cause.NO_PATH or not can_help:
            return None
        if sale.asides + 1 == len(ASIDES):
            return None
        sale.asides += 1
        where = f"{abs(sale.aside):.2f} m beside it"
        store.report(f"{outcome.text}; next, a place {where}", "warning")
        return self._send(store, trip)

    def _withdrawn(self, store: StoreState, outcome: Outcome) -> Outcome:
        """Return the outcome; blocked: the arm draws in first, then the base drives on without."""
        sale = store.sale
        can_help = outcome.cause == Cause.BLOCKED and "blocked" in STATES[store.visit.state].then
        if sale is None or not can_help or sale.withdrawals == _WITHDRAWALS:
            return outcome
        sale.withdrawals += 1
        store.report(f"{outcome.text}; draws the arm in, and drives on", "warning")
        return replace(outcome, name="blocked")

    def enter(self, store: StoreState, outcome: Outcome) -> Goal | None:
        """Enter the state that follows on an outcome; return its goal, if it has one."""
        state = STATES[store.visit.state].then[outcome.name]
        if state in {"retry", "stop"}:
            store.record_problem(outcome)
        return self._send(store, state)

    def _send(self, store: StoreState, state: str, *, is_planned: bool = False) -> Goal | None:
        """Start a visit to a state; return its goal, if it has one."""
        visit = Visit(state=state, start_ns=store.inputs.t_ns, is_planned=is_planned)
        store.visit, make_goal = visit, GOALS.get(state)
        if make_goal is None:
            return None
        goal = msgspec.structs.replace(make_goal(store), id=self._goals)
        self._goals += 1
        visit.goal, visit.goal_type = goal.id, goal.type
        if goal.type in {"go_to", "go_together"}:
            store.trip, store.destination = goal.id, goal.base
            store.trip_doing, store.trip_text = STATES[state].doing, ""
            store.inputs = replace(store.inputs, trip=None)
        return goal

    def _end(self, step: Step, store: StoreState) -> None:
        """End the run: now, or with an error after the last event."""
        self._is_done = True
        if store.visit.state == "failed":
            self._failure = store.failure()
            store.log.append(("error", self._failure))
        else:
            text = f"{len(store.results)} of {len(self._settings.orders)} sales are done"
            unsold = "; ".join(f"no {row.order}: {row.reason}" for row in store.unsold)
            step.end(f"{text}; {unsold}" if unsold else text)

    def _events(self, store: StoreState) -> dict[str, Message]:
        """Return the log of this step, and at the end the report."""
        logs, store.log = {self._ports.events: store.log}, []
        report = logs.setdefault(self._ports.summary, [])
        if self._is_done:
            text = summary(
                store.results,
                len(self._settings.orders),
                store.since(0),
                failure=self._failure,
                unsold=store.all_unsold(),
                by=WITNESSES[self._settings.verification],
            )
            report.append(("info", text))
        return {port: _event(log) for port, log in logs.items() if log}


def _lost(inputs: Inputs) -> Outcome | None:
    """Return that a participant has failed whose safe messages show it."""
    detections, pose = inputs.detections, inputs.pose
    if detections is not None and not detections.frame:
        return Outcome(name="failed", cause=Cause.NO_PERCEPTION, text="perception has failed")
    if pose is not None and not math.isfinite(pose.x + pose.y + pose.yaw):
        return Outcome(name="failed", cause=Cause.NO_POSE, text="the base's pose is unknown")
    return None


def _event(log: Sequence[LogEntry]) -> Event:
    """Return the entries as one message, a line each, with the highest level among them."""
    level = max((level for level, _ in log), key=_LEVELS.index)
    return Event(level=level, text="\n".join(text for _, text in log))


def _unknown(settings: Params, stock: Stock, links: Sequence[str]) -> list[str]:
    """Return a sentence for each item or link of the scenario that the plant does not have."""
    problems = [
        f"orders: item {order.item!r} is unknown{suggest(order.item, stock.measures)}"
        for order in settings.orders
        if order.item and order.item not in stock.measures
    ]
    if settings.catalog is None:
        problems += [
            f"orders: {unknown_type(order.type, stock.types)}"
            for order in settings.orders
            if order.type and order.type not in stock.types
        ]
    link = settings.outlet.link
    if link not in links:
        problems.append(f"outlet.link: link {link!r} is unknown{suggest(link, links)}")
    return problems
