"""The goal that each state sends to the controller: one function per state."""

from collections.abc import Callable, Mapping
from typing import Literal

import msgspec

from stepbus_schemas import Goal, Point
from stepbus_store.mission.geometry import Spot, gripper_down, spot_of
from stepbus_store.mission.state import StoreState

ODOMETRY = "odometry"
"""The frame of the goals: the pose of the base at the start."""

_Moving = Literal["move_to_pose", "move_linear"]

MakeGoal = Callable[[StoreState], Goal]


def tuck(store: StoreState) -> Goal:
    """Tuck the arm in, so that the base may move."""
    joints = store.settings.tuck
    return Goal(id=0, type="move_joints", joints=list(joints), values=list(joints.values()))


def drive(store: StoreState) -> Goal:
    """Drive in front of the item's column."""
    sale, item = store.now
    shelf = store.shelf(item)
    column = shelf.sees(item.position[0], item.position[1])[1] + sale.aside
    return _go_to(store, store.in_odometry(shelf.ahead(-store.settings.stand, left=column)))


def open_gripper(store: StoreState) -> Goal:
    """Open the gripper; its fingers then leave the camera's view."""
    return _grip(store, store.settings.opening)


def narrow(store: StoreState) -> Goal:
    """Open the gripper only as wide as the approach wants it."""
    return _grip(store, store.opening())


def inspect(store: StoreState) -> Goal:
    """Move the open gripper above the item's expected position."""
    _, item = store.now
    height = item.top + store.settings.view_height
    return _pose(store, "move_to_pose", store.expected(), height)


def approach(store: StoreState) -> Goal:
    """Move closer above the item; straight down, unless the gripper turns on the way."""
    sale, _ = store.now
    goal_type: _Moving = "move_to_pose" if sale.tries else "move_linear"
    return _pose(store, goal_type, store.expected(), _approach_height(store))


def shift(store: StoreState) -> Goal:
    """Follow the item at the same height."""
    return _pose(store, "move_linear", store.expected(), _approach_height(store))


def down(store: StoreState) -> Goal:
    """Move down, with the item between the open fingers; straight, if the approach is."""
    sale, _ = store.now
    goal_type: _Moving = "move_linear" if sale.approach.is_straight else "move_to_pose"
    return _pose(store, goal_type, store.expected(), store.grip_height(), slow=True)


def close(store: StoreState) -> Goal:
    """Close the gripper on the item."""
    return _grip(store, 0.0)


def lift(store: StoreState) -> Goal:
    """Lift the item straight up."""
    height = store.grip_height() + store.settings.lift_height
    return _pose(store, "move_linear", store.expected(), height, slow=True)


def retreat(store: StoreState) -> Goal:
    """Take the item off the shelf, over the base, without lowering it."""
    sale, _ = store.now
    return _pose(store, "move_to_pose", _carried(store), sale.tip)


def lower(store: StoreState) -> Goal:
    """Lower the item by one step."""
    sale, _ = store.now
    settings = store.settings
    height = min(sale.tip, max(sale.tip - settings.lower_step, settings.safe_height))
    return _pose(store, "move_linear", _carried(store), height)


def reverse(store: StoreState) -> Goal:
    """Drive back from the shelf, so that the base can turn."""
    return Goal(id=0, type="drive", by=-store.settings.reverse, touches=_touches(store))


def home(store: StoreState) -> Goal:
    """Drive home with the item."""
    sale, _ = store.now
    x, y, yaw = store.settings.home
    spot = Spot(x=x, y=y, yaw=yaw).ahead(sale.aside)
    return _go_to(store, store.in_odometry(spot))


def above(store: StoreState) -> Goal:
    """Move the item above its spot in the outlet."""
    height = _placed_height(store) + store.settings.approach_height
    return _pose(store, "move_to_pose", _spot(store), height)


def place(store: StoreState) -> Goal:
    """Put the item down on its spot."""
    return _pose(store, "move_linear", _spot(store), _placed_height(store), slow=True)


def up(store: StoreState) -> Goal:
    """Move straight up with the open gripper, away from the item."""
    _, item = store.now
    # The fingers have to clear the neck of the item.
    height = _placed_height(store) + max(store.settings.approach_height, item.top - item.bottom)
    return _pose(store, "move_linear", _spot(store), height, slow=True)


def draw_in(store: StoreState) -> Goal:
    """Take the item off the shelf, over the base, while the base leaves."""
    goal = _pose(store, "move_to_pose", _over_base(store), store.now[0].tip)
    return msgspec.structs.replace(goal, frame="")


def back_off(store: StoreState) -> Goal:
    """Move straight up from a failed attempt."""
    height = store.grip_height() + store.settings.approach_height
    return _pose(store, "move_linear", store.expected(), height, slow=True)


def stop(_: StoreState) -> Goal:
    """Bring base and arm to rest; the gripper keeps holding."""
    return Goal(id=0, type="stop")


def recover(store: StoreState) -> Goal:
    """Bring the arm back to rest from wherever it has stopped.

    With an item, it goes to where it carries that: tucked in, the item would be in the chassis.
    """
    joints, held = store.settings.tuck, store.sale.item if store.sale is not None else None
    if held is not None and store.inputs.gripper.holding:
        goal = _pose(store, "move_to_pose", _over_base(store), store.settings.safe_height)
        return msgspec.structs.replace(goal, type="back_to_rest", frame="", touches=[held.name])
    return Goal(
        id=0,
        type="back_to_rest",
        joints=list(joints),
        values=list(joints.values()),
        touches=[held.name] if held is not None else [],
    )


def _together(make: MakeGoal) -> MakeGoal:
    """Return the goal of a base that drives while the arm moves."""
    return lambda store: msgspec.structs.replace(make(store), type="go_together")


def _beside(make: MakeGoal) -> MakeGoal:
    """Return a goal that is carried out while the base drives."""
    return lambda store: msgspec.structs.replace(make(store), base=store.destination)


GOALS: Mapping[str, MakeGoal] = {
    "tuck": tuck,
    "drive": drive,
    "open": open_gripper,
    "narrow": narrow,
    "inspect": inspect,
    "approach": approach,
    "shift": shift,
    "down": down,
    "close": close,
    "lift": lift,
    "retreat": retreat,
    "lower": lower,
    "reverse": reverse,
    "home": home,
    "above": above,
    "place": place,
    "let_go": open_gripper,
    "up": up,
    "park": tuck,
    "release": open_gripper,
    "back_off": back_off,
    "stop": stop,
    "halt": stop,
    "recover": recover,
    "withdraw": recover,
    "fold_again": recover,
    "depart": _together(drive),
    "fold": _beside(tuck),
    "ready": _beside(open_gripper),
    "reach": _beside(inspect),
    "return": _together(home),
    "draw_in": _beside(draw_in),
    "bring": _beside(above),
}
"""State → its goal; the other states send none."""


def _pose(
    store: StoreState,
    goal_type: _Moving,
    spot: Spot,
    height: float,
    *,
    slow: bool = False,
) -> Goal:
    """Return a goal with the gripper pointing down and opening along the spot's heading.

    Where a line was blocked, a planned path stands for it.
    """
    sale, _ = store.now
    sale.tip = height
    if store.visit.is_planned:
        goal_type = "move_to_pose"
    position: Point = (spot.x, spot.y, height)
    return Goal(
        id=0,
        type=goal_type,
        tip=store.settings.tip,
        frame=ODOMETRY,
        position=position,
        orientation=gripper_down(spot.yaw),
        duration=store.settings.down if slow else 0.0,
        touches=_touches(store),
    )


def _go_to(store: StoreState, spot: Spot) -> Goal:
    return Goal(id=0, type="go_to", base=(spot.x, spot.y, spot.yaw), touches=_touches(store))


def _approach_height(store: StoreState) -> float:
    """Return the height of the tip above the item before it goes down [m]."""
    sale, _ = store.now
    return store.grip_height() + store.settings.approach_height + sale.approach.farther


def _grip(store: StoreState, width: float) -> Goal:
    sale, _ = store.now
    sale.opening = width
    force = store.settings.force
    return Goal(id=0, type="grip", width=width, force=force, touches=_touches(store))


_TOUCHING = (
    "down", "close", "lift", "retreat", "lower", "reverse", "home", "above", "release", "back_off",
    "return", "draw_in", "bring",
)  # fmt: skip
_PLACING = ("place", "let_go", "up")


def _touches(store: StoreState) -> list[str]:
    """Return the links the gripper may touch: the item, and the outlet while it puts it down."""
    state = store.visit.state
    if state not in _TOUCHING + _PLACING:
        return []
    _, item = store.now
    return [item.name, store.settings.outlet.link] if state in _PLACING else [item.name]


def _carried(store: StoreState) -> Spot:
    """Return where an item is carried: above the base, with the gripper aligned to it."""
    ahead, left = store.settings.carry
    return spot_of(store.inputs.odometry).ahead(ahead, left)


def _over_base(store: StoreState) -> Spot:
    """Return where an item is carried, in the frame of the base."""
    ahead, left = store.settings.carry
    return Spot(x=ahead, y=left, yaw=0.0)


def _spot(store: StoreState) -> Spot:
    """Return the sale's spot in the outlet."""
    sale, _ = store.now
    return store.in_odometry(store.settings.outlet_spot(sale.number - 1, store.planned))


def _placed_height(store: StoreState) -> float:
    """Return the height of the tip when it releases the item, just above the outlet [m]."""
    _, item = store.now
    top = store.settings.outlet.position[2] + store.settings.drop_height
    return top + store.grip_height() - item.bottom
