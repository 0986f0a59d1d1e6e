"""What the states of the mission read and write: the sale, its approaches, and how states end."""

import math
from dataclasses import dataclass, field, replace
from typing import Literal

from stepbus_schemas import (
    BaseState,
    Contacts,
    Detections,
    EmergencyStop,
    GoalStatus,
    GripperState,
    Imu,
    Point,
    Poses,
)
from stepbus_store.mission.geometry import Spot, nearest_quarter, spot_of, tilt_of
from stepbus_store.mission.inventory import Item, Stock
from stepbus_store.mission.params import Order, Params
from stepbus_store.mission.report import SaleResult, Unsold
from stepbus_store.mission.state_table import STATES
from stepbus_store.mission.witness import Blows, Witness


@dataclass(frozen=True, kw_only=True)
class Approach:
    """One approach; text: a phrase about it.

    turn: of the gripper about the vertical [rad]. farther: height above the usual one [m]. slack:
    how much wider than the item the gripper opens; None: as wide as usual [m]. is_straight: down in
    a straight line; else along a planned path.
    """

    text: str
    turn: float = 0.0
    farther: float = 0.0
    slack: float | None = None
    is_straight: bool = True


_QUARTER = math.pi / 2
_NARROW = 0.02
"""Room between an item and the pads of a gripper that opens no wider than it has to [m]."""

ASIDES = (0.0, 0.3, -0.3, 0.45, -0.45, 0.6, -0.6)
"""How far from its place before a shelf, or the outlet, the base may stand along that [m]."""

APPROACHES = (
    Approach(text="straight down"),
    Approach(text="with the gripper turned by 90°", turn=_QUARTER),
    Approach(text="with the gripper turned by -90°", turn=-_QUARTER),
    Approach(text="with the gripper turned by 180°, from farther", turn=math.pi, farther=0.1),
    Approach(text="along a planned path", is_straight=False),
    Approach(text="turned by 90°, along a planned path", turn=_QUARTER, is_straight=False),
    Approach(text="opened less", slack=_NARROW),
    Approach(text="turned by 90°, opened less", turn=_QUARTER, slack=_NARROW),
)
"""In this order; another attempt takes the next one."""

Level = Literal["info", "warning", "error"]
LogEntry = tuple[Level, str]
"""Severity and text."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a state ended.

    name: of the outcome in the table of states. cause: one word for programs; text: a phrase with
    numbers; both are empty unless something went wrong. doing: the activity that failed, if it is
    not that of the state.
    """

    name: str
    cause: str = ""
    text: str = ""
    doing: str = ""


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """The inputs at one step.

    pose: of the base on the map; None: odometry is right. status: of the latest goal; None: none
    yet. trip: the same of the base's goal, where others are carried out beside it. detections: None
    unless new at this step. contacts: of the robot; stop: the emergency stop; imu: of the base;
    None where nothing senses them.
    """

    t_ns: int
    poses: Poses
    odometry: BaseState
    gripper: GripperState
    pose: BaseState | None = None
    status: GoalStatus | None = None
    trip: GoalStatus | None = None
    detections: Detections | None = None
    contacts: Contacts | None = None
    stop: EmergencyStop | None = None
    imu: Imu | None = None


@dataclass(kw_only=True)
class Visit:
    """One visit to a state.

    start_ns: when it started [ns]. goal: id of the goal sent, -1: none. views: detections
    received. asked_ns: when the latest image was asked for, None: none yet [ns]. last_text: latest
    text of the running goal's status. since_ns: since when the condition holds that the state waits
    for [ns]. is_planned: a planned path stands for a line.
    """

    state: str
    start_ns: int
    goal: int = -1
    goal_type: str = ""
    views: int = 0
    asked_ns: int | None = None
    last_text: str = ""
    since_ns: int | None = None
    is_planned: bool = False


@dataclass(kw_only=True)
class Sale:
    """One order in progress.

    number: counted from 1. start_ns: when it started [ns]. item: None: not chosen yet. detected:
    latest detected position, with the heading along which the gripper opens. tip: height of the
    gripper's tip at its latest goal [m]. attempts: to grasp the item. detection_error: of the
    latest detection [m]; None: unknown. lost_ns: since when a carried item is not held [ns].
    asides: how many other places of the base have been tried on the way to the shelf, or home.
    withdrawals: how often the arm was drawn in on the way, to drive again.
    """

    number: int
    order: Order
    start_ns: int
    item: Item | None = None
    detected: Spot | None = None
    tip: float = 0.0
    attempts: int = 0
    tries: int = 0
    opening: float = 0.0
    corrections: int = 0
    detection_error: float | None = None
    lost_ns: int | None = None
    asides: int = 0
    withdrawals: int = 0

    @property
    def aside(self) -> float:
        """Return how far along the shelf, or the outlet, from its place the base stands [m]."""
        return ASIDES[self.asides]

    @property
    def approach(self) -> Approach:
        """Return how the gripper comes to the item; each try takes another approach."""
        return APPROACHES[min(self.tries, len(APPROACHES) - 1)]

    def __str__(self) -> str:
        return f"sale {self.number} ({self.item.name if self.item else self.order})"


@dataclass(kw_only=True)
class StoreState:
    """All that the states read and write.

    settings: of the scenario. planned: number of orders at the start. witness: of items that move;
    None: that is not watched. blows: on the robot; blow: before the problem. started: number of
    orders started. missing: items that could not be taken, and why. unsold: orders that were left
    out. log: entries of this step. problem: the latest failure; doing: the activity that failed;
    attempts_text: how many attempts failed. rest: how the emergency stop went. trip: id of the goal
    of the base beside which others are carried out, with its destination, activity and latest text.
    """

    settings: Params
    planned: int
    stock: Stock
    witness: Witness | None
    blows: Blows
    visit: Visit
    inputs: Inputs
    sale: Sale | None = None
    started: int = 0
    missing: dict[str, str] = field(default_factory=dict)
    sold: list[str] = field(default_factory=list)
    results: list[SaleResult] = field(default_factory=list)
    unsold: list[Unsold] = field(default_factory=list)
    log: list[LogEntry] = field(default_factory=list)
    problem: Outcome | None = None
    blow: str = ""
    doing: str = ""
    attempts_text: str = ""
    rest: str = ""
    trip: int = -1
    destination: Point | None = None
    trip_doing: str = ""
    trip_text: str = ""

    @property
    def now(self) -> tuple[Sale, Item]:
        """Return the sale in progress and its item."""
        if self.sale is None or self.sale.item is None:
            raise LookupError(f"state {self.visit.state!r} needs an item")
        return self.sale, self.sale.item

    @property
    def item(self) -> Item:
        """Return the item of the sale in progress."""
        return self.now[1]

    def report(self, text: str, level: Level = "info") -> None:
        """Log a sentence about the sale in progress."""
        self.log.append((level, f"{self.sale}: {text}"))

    @property
    def tilt(self) -> float:
        """Return by how much the base is tilted [rad]; 0 where nothing measures it."""
        imu = self.inputs.imu
        return 0.0 if imu is None or imu.orientation is None else tilt_of(imu.orientation)

    @property
    def elapsed(self) -> float:
        """Return the time since the state was entered [s]."""
        return self.since(self.visit.start_ns)

    def since(self, t_ns: int) -> float:
        """Return the time since `t_ns` [ns] in seconds."""
        return (self.inputs.t_ns - t_ns) * 1e-9

    def record_problem(self, outcome: Outcome) -> None:
        """Record the failure of the state that ends."""
        if self.visit.state == "retry":
            self.attempts_text = outcome.text
        else:
            self.problem, blow = outcome, self.blows.text(self.since(0))
            self.blow = f"; {blow}" if blow and " touches " not in outcome.text else ""
            self.doing = outcome.doing or STATES[self.visit.state].doing
            self.attempts_text = ""

    def all_unsold(self) -> list[Unsold]:
        """Return the orders that were left out, the one that failed, and those after it."""
        rows, sale = {}, self.sale
        for number, order in enumerate(self.settings.orders, 1):
            rows[number] = Unsold(number=number, order=str(order), reason="not tried")
        if self.problem and sale:
            name = sale.item.name if sale.item else str(sale.order)
            reason = f"failed while {self.doing}"
            rows[sale.number] = Unsold(number=sale.number, order=name, reason=reason)
        rows |= {row.number: row for row in self.unsold}
        sold = {result.number for result in self.results}
        return [row for number, row in rows.items() if number not in sold]

    def failure(self) -> str:
        """Return a sentence about the failure, and how the stop went."""
        subject = self.sale or "the mission"
        text = self.problem.text if self.problem else ""
        attempts = f", {self.attempts_text}" if self.attempts_text else ""
        return f"{subject} failed while {self.doing}: {text}{self.blow}{attempts}; {self.rest}"

    def shelf(self, item: Item) -> Spot:
        """Return a point on the front line of an item's shelf, with the heading towards it."""
        return self.settings.shelves[item.shelf].spot

    def outlet_spot(self) -> Spot:
        """Return the item's spot in the outlet."""
        return self.settings.outlet_spot(self.now[0].number - 1, self.planned)

    def in_odometry(self, spot: Spot) -> Spot:
        """Return a spot of the map in the frame of odometry, which drifts (ROS, REP 105)."""
        pose = self.inputs.pose
        if pose is None:
            return spot
        base = spot_of(self.inputs.odometry)
        ahead, left = spot_of(pose).sees(spot.x, spot.y)
        return replace(base.ahead(ahead, left), yaw=base.yaw + spot.yaw - pose.yaw)

    def expected(self) -> Spot:
        """Return the item's expected position, with the heading along which the gripper opens."""
        sale, item = self.now
        place = Spot(x=item.position[0], y=item.position[1], yaw=item.yaw)
        spot = sale.detected or self.in_odometry(place)
        return replace(spot, yaw=self.opening_yaw(spot.yaw))

    def opening_yaw(self, yaw: float) -> float:
        """Return the heading along which the gripper opens, for an item with this yaw [rad].

        It points into the shelf, between the item's neighbours, unless the approach is turned; a
        box is gripped at its sides.
        """
        sale, item = self.now
        shelf = self.in_odometry(self.shelf(item))
        along = shelf.yaw + sale.approach.turn
        return nearest_quarter(yaw, along) if item.measures.is_box else along

    def opening(self) -> float:
        """Return how wide the gripper opens for the item [m]."""
        sale, item = self.now
        slack, widest = sale.approach.slack, self.settings.opening
        if slack is None:
            return widest
        return min(item.width_along(self.expected().yaw) + slack, widest)

    def grip_height(self) -> float:
        """Return the height of the tip when it grips the item [m]."""
        item, settings = self.item, self.settings
        body_top = item.position[2] + item.measures.body_top
        return max(body_top - settings.grasp_depth, item.top - settings.grasp_reach)
