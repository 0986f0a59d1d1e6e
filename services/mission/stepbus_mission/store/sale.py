"""What the mission knows while it sells: the sale under way, and what it sees at a step."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from stepbus_schemas import BaseState, Detections, GoalStatus, GripperState, Poses

from .geometry import Spot, nearest_quarter
from .report import Row
from .settings import Order, StoreSettings
from .stock import Item, Stock
from .table import TABLE

Level = Literal["info", "warning", "error"]
Told = tuple[Level, str]
"""How much a sentence matters, and the sentence."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a state ended: the word of the table; why: a phrase with numbers, where it went wrong.

    cause: one word for programs.
    """

    word: str
    cause: str = ""
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What the mission sees at one step.

    status: of the newest goal, None: nothing yet. detections: None: nothing new at this step.
    """

    t_ns: int
    poses: Poses
    odometry: BaseState
    hand: GripperState
    status: GoalStatus | None = None
    detections: Detections | None = None


@dataclass(kw_only=True)
class Visit:
    """One stay in a state, since a time [ns]; goal: id of the one that was sent, -1: none.

    looks: detections looked at. heard: what the controller said last, on the way. since_ns: since
    when that holds which the state waits for.
    """

    state: str
    began_ns: int
    goal: int = -1
    kind: str = ""
    looks: int = 0
    heard: str = ""
    since_ns: int | None = None


@dataclass(kw_only=True)
class Sale:
    """One order under way, since a time [ns]; number: counted from 1.

    item: that is gone for; None: not chosen yet. place: where it was seen last, with the heading
    along which the hand opens. tip: height of the hand's tip where it was sent last [m]. attempts:
    to grasp it. found_off: of the last detection from the truth [m]. lost_ns: since when it has
    not been held while it is carried.
    """

    number: int
    order: Order
    began_ns: int
    item: Item | None = None
    place: Spot | None = None
    tip: float = 0.0
    attempts: int = 0
    corrections: int = 0
    found_off: float = 0.0
    lost_ns: int | None = None

    def __str__(self) -> str:
        return f"sale {self.number} ({self.item.name if self.item else self.order})"


@dataclass(kw_only=True)
class Shop:
    """All that the states read and write.

    settings: of the scenario. seen: at this step. begun: orders that were begun. missing: names of
    items that were not found. rows: of the report. told: what there is to say at this step.
    problem: what went wrong last, and doing: while what was being done; spent: the attempts that
    were of no use. rest: how the stop went.
    """

    settings: StoreSettings
    stock: Stock
    visit: Visit
    seen: Seen
    sale: Sale | None = None
    begun: int = 0
    missing: list[str] = field(default_factory=list)
    sold: list[str] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    told: list[Told] = field(default_factory=list)
    problem: Outcome | None = None
    doing: str = ""
    spent: str = ""
    rest: str = ""

    @property
    def now(self) -> tuple[Sale, Item]:
        """Return the sale under way and its item."""
        if self.sale is None or self.sale.item is None:
            raise LookupError(f"state {self.visit.state!r} needs an item")
        return self.sale, self.sale.item

    def tell(self, text: str, level: Level = "info") -> None:
        """Say something about the sale under way."""
        self.told.append((level, f"{self.sale}: {text}"))

    @property
    def carries(self) -> bool:
        """Return whether an item is being carried, so that it can be lost."""
        return TABLE[self.visit.state].carries

    @property
    def lasts(self) -> float:
        """Return for how long the state has been stayed in [s]."""
        return self.since(self.visit.began_ns)

    def since(self, t_ns: int) -> float:
        """Return how long ago a time [ns] was [s]."""
        return (self.seen.t_ns - t_ns) * 1e-9

    def note(self, outcome: Outcome) -> None:
        """Keep what went wrong in the state that is being left."""
        if self.visit.state == "retry":
            self.spent = outcome.why
        else:
            self.problem, self.doing, self.spent = outcome, TABLE[self.visit.state].doing, ""

    def failure(self) -> str:
        """Return the one sentence about what led to the stop, and how the stop went."""
        who = self.sale or "the mission"
        why = self.problem.why if self.problem else ""
        spent = f", {self.spent}" if self.spent else ""
        return f"{who} failed while {self.doing}: {why}{spent}; {self.rest}"

    def shelf(self, item: Item) -> Spot:
        """Return the shelf that an item stands on: a point of its front line, facing it."""
        return self.settings.shelves[item.shelf]

    def expected(self) -> Spot:
        """Return where the item should be, with the heading along which the hand opens."""
        sale, item = self.now
        if sale.place is not None:
            return sale.place
        return Spot(x=item.position[0], y=item.position[1], yaw=self.opening_yaw(item.yaw))

    def opening_yaw(self, yaw: float) -> float:
        """Return the heading along which the hand opens for the item, which has a yaw [rad].

        It is the shelf's depth, as the neighbours stand beside; boxes are gripped at their sides.
        """
        _, item = self.now
        along = self.shelf(item).yaw + self.settings.grasp.yaw
        return nearest_quarter(yaw, along) if item.measures.is_box else along

    def grip_height(self) -> float:
        """Return the height of the tip where the item is gripped [m]."""
        _, item = self.now
        grasp = self.settings.grasp
        return max(item.body_top - grasp.depth, item.top - grasp.reach)
