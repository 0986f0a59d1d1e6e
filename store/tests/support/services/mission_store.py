"""A store in pure Python: it carries out every goal at once, or fails as a test wants it to."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

from support.services.control import make_config

from stepbus_participant import Config
from stepbus_schemas import (
    BaseState,
    Contacts,
    Description,
    Detections,
    EmergencyStop,
    Goal,
    GoalStatus,
    GripperState,
    Imu,
    Poses,
)

STEP_NS = 20_000_000
PAUSE = 8
"""Steps from a goal's first statuses to its last one."""
IDENTITY = (0.0, 0.0, 0.0, 1.0)
AT = " @ 0 0 0 0 0 0 1"
SHAPES = {
    "cola": "cylinder 0.033 0.115" + AT,
    "water": "cylinder 0.032 0.1" + AT + "; cylinder 0.015 0.05 @ 0 0 0.075 0 0 0 1",
    "juice": "box 0.06 0.06 0.12" + AT,
}
BOTTOMS = {"cola": 0.0575, "water": 0.05, "juice": 0.06}
CENTRES = {"water": 0.025}
"""Height of the centre of the bounding box above the middle of the body [m]."""
WIDTHS = {"cola": 0.066, "water": 0.064, "juice": 0.06}
SHELF_A = {"front": [1.95, 0.0], "yaw": 0.0}
SHELF_B = {"front": [0.0, -1.95], "yaw": -math.pi / 2}
OUTLET = {"position": [0.15, 0.65, 0.35], "pitch": 0.12}
PARAMS = {
    "orders": ["cola"],
    "shelves": {"a": SHELF_A, "b": SHELF_B},
    "outlet": OUTLET,
    "tuck": {"shoulder_pan_joint": 0.0, "elbow_joint": 2.0},
}


def config(
    *, localized: bool = False, requests: bool = False, feels: bool = False, **params
) -> Config:
    """Return the configuration of a mission; localized: wired as in `store`, else `store/truth`.

    requests: whether it asks for images. feels: whether contacts are sensed.
    """
    inputs = {
        "poses": "Poses/1",
        "detections": "Detections/1",
        "stop": "EmergencyStop/1",
        "imu": "Imu/1",
        "gripper": "GripperState/1",
        "odometry": "BaseState/1",
        "goal_status": "GoalStatus/1",
    }
    if localized:
        inputs |= {"planogram": "Poses/1", "pose": "BaseState/1"}
    if feels:
        inputs["contacts"] = "Contacts/1"
    outputs = {"goal": "Goal/1", "events": "Event/1", "summary": "Event/1"}
    if requests:
        outputs["camera"] = "CameraTrigger/1"
    params = {**PARAMS, **params}
    return make_config("mission", inputs, outputs, Path(), params=params, step_ns=STEP_NS)


@dataclass
class Thing:
    """An item: where the middle of its body is, and its yaw."""

    kind: str
    x: float
    y: float
    z: float
    yaw: float = 0.0
    tilt: float = 0.0

    @property
    def orientation(self):
        if self.tilt:
            return (math.sin(self.tilt / 2), 0.0, 0.0, math.cos(self.tilt / 2))
        return (0.0, 0.0, math.sin(self.yaw / 2), math.cos(self.yaw / 2))


def shelf_a(*kinds_and_columns) -> dict[str, Thing]:
    """Return items of the first row of shelf a, by name: (kind, column) each."""
    things = {}
    for kind, column in kinds_and_columns:
        z = 0.2 + BOTTOMS[kind]
        things[f"{kind}_a1_{column}"] = Thing(kind, 2.015, 0.1 * (column - 4), z)
    return things


@dataclass
class FakeStore:
    """The plant, the perception and the controller of a test.

    Events are named by the state that the mission is in and how often it has sent a goal from
    there, e.g. ("lift", 1).

    fails: event → cause. fails_late: the same of a go_together, at its end. slower: event → text. overturns: events at which the robot falls over. stops: event → seconds of an emergency stop. silent: events without any status. endless: those that only ever run.
    drops: those at which the item is lost. pushes: event → item that is pushed, and by how much
    along x [m]. hides: event → item that is not seen from then on. slips: how many lifts lose the
    item. empty_grips: how many times the fingers miss it. shift: of every detection, x and y [m];
    noise: of every other one. hidden: names that are not seen. dark: no detections, from an event
    on. drifts: the base does not stand. place_shift: of an item that is let go of [m]. tips: it
    falls over then. seen_width: what the gripper says instead of the truth [m].
    frame: that the detections say they are given in. drift: where the map has the origin of
    odometry, x, y, yaw [m, rad]; then the mission gets a planogram and a pose instead of the truth.
    requested: the camera waits for requests; loses: how many of these it loses. covered: share of
    every spot that is hidden. feels: contacts are sensed: of the
    floor, and of what makes the robot fall over.
    """

    things: dict[str, Thing]
    fails: dict = field(default_factory=dict)
    fails_late: dict = field(default_factory=dict)
    slower: dict = field(default_factory=dict)
    stops: dict = field(default_factory=dict)
    overturns: tuple = ()
    silent: tuple = ()
    endless: tuple = ()
    drops: tuple = ()
    pushes: dict = field(default_factory=dict)
    hides: dict = field(default_factory=dict)
    slips: int = 0
    empty_grips: int = 0
    shift: tuple = (0.0, 0.0)
    noise: float = 0.0
    hidden: tuple = ()
    dark: tuple | None = None
    drifts: bool = False
    place_shift: float = 0.0
    tips: bool = False
    seen_width: float | None = None
    frame: str = "chassis"
    feels: bool = False
    drift: tuple | None = None
    requested: bool = False
    loses: int = 0
    covered: float = 0.0

    def __post_init__(self):
        self.base = (0.0, 0.0, 0.0)
        self.tip = (0.4, 0.0, 0.8)
        self.held = None
        self.gap = (0.0, 0.0, 0.0)
        self.width = 0.05
        self.goals = []
        self.states = []
        self.sent = {}
        self.news = []
        self.trip = -1
        self.pictures = 0
        self.asked = None
        self.stop = EmergencyStop(active=False)
        self.is_dark = self.dark == ("order", 0)
        self.planogram = self.poses()
        self.stopped_for = None
        self.has_fallen = False
        for thing in self.things.values() if self.drift else ():
            # A fake store lives in the frame of odometry.
            thing.x, thing.y, thing.yaw = self.in_odometry(thing.x, thing.y, thing.yaw)

    def in_odometry(self, x, y, yaw):
        x0, y0, yaw0 = self.drift
        c, s = math.cos(yaw0), math.sin(yaw0)
        return c * (x - x0) + s * (y - y0), c * (y - y0) - s * (x - x0), yaw - yaw0

    def pose(self) -> BaseState:
        """Return where the base is on the map."""
        (x, y, yaw), (x0, y0, yaw0) = self.base, self.drift
        c, s = math.cos(yaw0), math.sin(yaw0)
        return BaseState(x=x0 + c * x - s * y, y=y0 + s * x + c * y, yaw=yaw0 + yaw, vx=0.0, wz=0.0)

    def description(self) -> Description:
        names = ["chassis", *self.things, "outlet_top"]
        kinds = ["", *(thing.kind for thing in self.things.values()), ""]
        shapes = ["", *(SHAPES[thing.kind] for thing in self.things.values()), "box 0.5 0.2 0.35"]
        return Description(names=names, details={"type": kinds, "shape": shapes})

    def poses(self) -> Poses:
        rows = list(self.things.values())
        x, y, yaw = self.base
        turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        return Poses(
            position=[(x, y, 0.0), *((t.x, t.y, t.z) for t in rows), (0.15, 0.65, 0.0)],
            orientation=[turn, *(t.orientation for t in rows), IDENTITY],
        )

    def contacts(self) -> Contacts:
        rows = [("chassis", "floor", 600.0), ("chassis", "crate_box", 812.4)][: 1 + self.has_fallen]
        return Contacts(
            pairs=[row[:2] for row in rows],
            force=[0.0 for _ in rows],
            distance=[0.0 for _ in rows],
            position=[(0.0, 0.0, 0.0) for _ in rows],
            peak_force=[row[2] for row in rows],
        )

    def odometry(self) -> BaseState:
        x, y, yaw = self.base
        return BaseState(x=x, y=y, yaw=yaw, vx=0.05 if self.drifts else 0.0, wz=0.0)

    def gripper(self) -> GripperState:
        holding = self.held is not None
        width = self.width if self.seen_width is None else self.seen_width
        return GripperState(width=width, force=15.0 if holding else 0.0, holding=holding)

    def is_due(self, index: int) -> bool:
        """Return whether there is an image at a step."""
        if not self.requested:
            return index % 5 == 0
        lost = self.asked is not None and self.loses > 0
        self.loses -= lost
        return self.asked is not None and not lost

    def detections(self) -> Detections | None:
        """Return what the camera sees of the items near the gripper, in the frame of the base."""
        if self.is_dark:
            return None
        self.pictures += 1
        x0, y0, yaw = self.base
        shift = self.shift[0] + (self.noise if self.pictures % 2 else 0.0), self.shift[1]
        seen = [
            (thing.kind, thing.x + shift[0] - x0, thing.y + shift[1] - y0, thing)
            for name, thing in self.things.items()
            if name not in self.hidden
        ]
        c, s = math.cos(yaw), math.sin(yaw)
        half = [(thing.yaw - yaw) / 2 for *_, thing in seen]
        return Detections(
            frame=self.frame,
            types=[kind for kind, *_ in seen],
            position=[
                (c * x + s * y, c * y - s * x, t.z + CENTRES.get(t.kind, 0.0))
                for _, x, y, t in seen
            ],
            orientation=[
                t.orientation if t.tilt else (0.0, 0.0, math.sin(h), math.cos(h))
                for h, (*_, t) in zip(half, seen, strict=True)
            ],
            confidence=[1.0] * len(seen),
            hidden=self.covered,
        )

    def imu(self) -> Imu:
        half = 0.8 if self.has_fallen else 0.01
        upright = (math.sin(half), 0.0, 0.0, math.cos(half))
        return Imu(
            angular_velocity=(0, 0, 0), linear_acceleration=(0, 0, 9.81), orientation=upright
        )

    def switch(self, t: float) -> EmergencyStop:
        """Return the emergency stop at a time [s]."""
        if self.stopped_for is not None and not self.stop.active:
            self.stop = EmergencyStop(active=True, by="a guard", since=t)
        elif self.stop.active and t >= self.stop.since + self.stopped_for - 1e-9:
            self.stop = EmergencyStop(active=False, by="a nurse", since=t)
            self.stopped_for = None
        return self.stop

    def carry_out(self, goal: Goal, state: str) -> None:
        """Do what a goal wants that was sent from a state, and have its statuses ready."""
        self.goals.append(goal)
        self.states.append(state)
        self.sent[state] = self.sent.get(state, 0) + 1
        which = (state, self.sent[state])
        # Beside its arm, the base goes on with its goal.
        beside = goal.base is not None and not goal.type.startswith("go_")
        trip = [row for row in self.news if row is not None and row.id == self.trip]
        self.trip = goal.id if goal.type == "go_together" else self.trip if beside else -1
        self.news = []
        if which in self.silent:
            return
        self.news = [
            GoalStatus(id=goal.id, state="accepted"),
            GoalStatus(id=goal.id, state="running"),
        ]
        if which in self.endless:
            return
        self.has_fallen |= which in self.overturns
        if which in self.stops:
            self.stopped_for = self.stops.pop(which)
            self.news.append(GoalStatus(id=goal.id, state="failed", cause="emergency_stop"))
            return
        if which in self.fails:
            text = "as the test wants it"
            cause = self.fails[which]
            self.news.append(GoalStatus(id=goal.id, state="failed", cause=cause, text=text))
            return
        if which in self.fails_late:
            late = GoalStatus(id=goal.id, state="failed", cause=self.fails_late[which], text="late")
            self.news += [None] * PAUSE + [late]
            return
        self._do(goal)
        self._happen(which)
        self.news += [None] * PAUSE
        text = self.slower.get(which, "")
        cause, text = ("slower", f"{text}; settled") if text else ("", "")
        self.news.append(GoalStatus(id=goal.id, state="succeeded", cause=cause, text=text))
        self.news += [*[None] * (PAUSE if trip else 0), *(trip if beside else [])]

    def _happen(self, which) -> None:
        if which in self.pushes:
            name, by = self.pushes[which]
            self.things[name].x += by
        if which in self.hides:
            self.hidden = (*self.hidden, self.hides[which])
        if which in self.drops:
            self.held, self.width = None, 0.0
        self.is_dark |= which == self.dark

    def _do(self, goal: Goal) -> None:
        if goal.type in {"go_to", "go_together"}:
            self._drive(*goal.base)
        elif goal.type == "drive":
            x, y, yaw = self.base
            self._drive(x + goal.by * math.cos(yaw), y + goal.by * math.sin(yaw), yaw)
        elif goal.type in {"move_to_pose", "move_linear"}:
            self._move(self._in_odometry(goal.position) if not goal.frame else goal.position)
        elif goal.type == "grip":
            self._grip(goal.width)

    def _in_odometry(self, position):
        x, y, yaw = self.base
        dx, dy, z = position
        c, s = math.cos(yaw), math.sin(yaw)
        return (x + c * dx - s * dy, y + s * dx + c * dy, z)

    def _drive(self, x, y, yaw):
        # The tip goes along with the base.
        x0, y0, yaw0 = self.base
        turn = yaw - yaw0
        dx, dy = self.tip[0] - x0, self.tip[1] - y0
        c, s = math.cos(turn), math.sin(turn)
        self.base = (x, y, yaw)
        self._move((x + c * dx - s * dy, y + s * dx + c * dy, self.tip[2]))

    def _move(self, position):
        rises = position[2] - self.tip[2]
        self.tip = position
        if self.held and rises > 0.05 and self.slips:
            self.slips -= 1
            self.held, self.width = None, 0.0
        if self.held:
            x, y, z = (t - g for t, g in zip(self.tip, self.gap, strict=True))
            self.things[self.held] = replace(self.things[self.held], x=x, y=y, z=z)

    def _grip(self, width):
        near = self._between()
        if width > 0.0:
            if self.held:
                thing = self.things[self.held]
                thing.z, thing.x = 0.35 + BOTTOMS[thing.kind], thing.x + self.place_shift
                thing.tilt = 1.5 if self.tips else 0.0
            self.held, self.width = None, width
        elif near and not self.empty_grips:
            thing = self.things[near]
            self.held, self.width = near, WIDTHS[thing.kind]
            self.gap = tuple(
                t - p for t, p in zip(self.tip, (thing.x, thing.y, thing.z), strict=True)
            )
        else:
            self.empty_grips -= bool(near)
            self.width = 0.0

    def _between(self):
        for name, thing in self.things.items():
            x, y, z = (t - p for t, p in zip(self.tip, (thing.x, thing.y, thing.z), strict=True))
            if math.hypot(x, y) < 0.012 and 0.0 < z < BOTTOMS[thing.kind]:
                return name
        return None
