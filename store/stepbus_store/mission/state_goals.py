"""The goal that each state sends to the controller."""

from collections.abc import Callable, Mapping

import msgspec

from stepbus_schemas import Goal
from stepbus_store.mission.geometry import Spot, gripper_down, spot_of
from stepbus_store.mission.state import StoreState

ODOMETRY = "odometry"
"""The frame of the goals: the pose of the base at the start."""

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
    return _go_to(store, shelf.ahead(-store.settings.stand, left=column))


def home(store: StoreState) -> Goal:
    """Drive home with the item."""
    x, y, yaw = store.settings.home
    return _go_to(store, Spot(x=x, y=y, yaw=yaw).ahead(store.now[0].aside))


def open_gripper(store: StoreState) -> Goal:
    """Open the gripper; its fingers then leave the camera's view."""
    return _grip(store, store.settings.opening)


def inspect(store: StoreState) -> Goal:
    """Move the open gripper above the item's expected position."""
    height = store.item.top + store.settings.view_height
    return _pose(store, store.expected(), height, straight=False)


def approach(store: StoreState) -> Goal:
    """Move closer above the item; straight down, unless the gripper turns on the way."""
    return _above_item(store, straight=not store.now[0].tries)


def down(store: StoreState) -> Goal:
    """Move down, with the item between the open fingers; straight, if the approach is."""
    straight = store.now[0].approach.is_straight
    return _pose(store, store.expected(), store.grip_height(), straight=straight, slow=True)


def lower(store: StoreState) -> Goal:
    """Lower the item by one step."""
    tip, settings = store.now[0].tip, store.settings
    height = min(tip, max(tip - settings.lower_step, settings.safe_height))
    return _pose(store, _carried(store), height)


def reverse(store: StoreState) -> Goal:
    """Drive back from the shelf, so that the base can turn."""
    return Goal(id=0, type="drive", by=-store.settings.reverse, touches=_touches(store))


def above(store: StoreState) -> Goal:
    """Move the item above its spot in the outlet."""
    return _place(store, store.settings.approach_height, straight=False)


def up(store: StoreState) -> Goal:
    """Move straight up with the open gripper, away from the item, whose neck it has to clear."""
    tall = store.item.top - store.item.bottom
    return _place(store, max(store.settings.approach_height, tall), slow=True)


def stop(_: StoreState) -> Goal:
    """Bring base and arm to rest; the gripper keeps holding."""
    return Goal(id=0, type="stop")


def recover(store: StoreState) -> Goal:
    """Bring the arm back to rest from wherever it has stopped.

    With an item, it goes to where it carries that: tucked in, the item would be in the chassis.
    """
    held = store.sale.item if store.sale is not None else None
    carries = held is not None and store.inputs.gripper.holding
    goal = _draw_in(store, store.settings.safe_height) if carries else tuck(store)
    touches = [held.name] if held is not None else []
    return msgspec.structs.replace(goal, type="back_to_rest", touches=touches)


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
    "narrow": lambda store: _grip(store, store.opening()),
    "inspect": inspect,
    "approach": approach,
    "shift": lambda store: _above_item(store, straight=True),
    "down": down,
    "close": lambda store: _grip(store, 0.0),
    "lift": lambda store: _raise(store, store.settings.lift_height),
    "retreat": lambda store: _pose(store, _carried(store), store.now[0].tip, straight=False),
    "lower": lower,
    "reverse": reverse,
    "home": home,
    "above": above,
    "place": lambda store: _place(store, 0.0, slow=True),
    "let_go": open_gripper,
    "up": up,
    "park": tuck,
    "release": open_gripper,
    "back_off": lambda store: _raise(store, store.settings.approach_height),
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
    "draw_in": _beside(lambda store: _draw_in(store, store.now[0].tip)),
    "bring": _beside(above),
}
"""State → its goal; the other states send none."""


def _pose(
    store: StoreState,
    spot: Spot,
    height: float,
    *,
    frame: str = ODOMETRY,
    straight: bool = True,
    slow: bool = False,
) -> Goal:
    """Return a goal with the gripper pointing down and opening along the spot's heading.

    Where a line was blocked, a planned path stands for it.
    """
    store.now[0].tip = height
    return Goal(
        id=0,
        type="move_linear" if straight and not store.visit.is_planned else "move_to_pose",
        tip=store.settings.tip,
        frame=frame,
        position=(spot.x, spot.y, height),
        orientation=gripper_down(spot.yaw),
        duration=store.settings.down if slow else 0.0,
        touches=_touches(store),
    )


def _above_item(store: StoreState, *, straight: bool) -> Goal:
    """Return a goal as high above the item as the gripper goes down from."""
    height = store.grip_height() + store.settings.approach_height + store.now[0].approach.farther
    return _pose(store, store.expected(), height, straight=straight)


def _raise(store: StoreState, by: float) -> Goal:
    """Return a goal straight up from the grip [m]."""
    return _pose(store, store.expected(), store.grip_height() + by, slow=True)


def _place(store: StoreState, up: float, *, straight: bool = True, slow: bool = False) -> Goal:
    """Return a goal this far above where the gripper releases the item, above the outlet [m]."""
    top = store.settings.outlet.position[2] + store.settings.drop_height
    height = top + store.grip_height() - store.item.bottom + up
    spot = store.in_odometry(store.outlet_spot())
    return _pose(store, spot, height, straight=straight, slow=slow)


def _draw_in(store: StoreState, height: float) -> Goal:
    """Return a goal with the item over the base, wherever that goes meanwhile."""
    ahead, left = store.settings.carry
    return _pose(store, Spot(x=ahead, y=left, yaw=0.0), height, frame="", straight=False)


def _go_to(store: StoreState, spot: Spot) -> Goal:
    """Return a goal of the base at a spot of the map."""
    spot = store.in_odometry(spot)
    return Goal(id=0, type="go_to", base=(spot.x, spot.y, spot.yaw), touches=_touches(store))


def _grip(store: StoreState, width: float) -> Goal:
    store.now[0].opening = width
    force = store.settings.force
    return Goal(id=0, type="grip", width=width, force=force, touches=_touches(store))


_TOUCHING = (
    "down", "close", "lift", "retreat", "lower", "reverse", "home", "above", "release", "back_off",
    "return", "draw_in", "bring",
)  # fmt: skip
_PLACING = ("place", "let_go", "up")


def _touches(store: StoreState) -> list[str]:
    """Return the links the gripper may touch: the item, and the outlet while it puts it down."""
    if store.visit.state in _PLACING:
        return [store.item.name, store.settings.outlet.link]
    return [store.item.name] if store.visit.state in _TOUCHING else []


def _carried(store: StoreState) -> Spot:
    """Return where an item is carried: above the base, with the gripper aligned to it."""
    return spot_of(store.inputs.odometry).ahead(*store.settings.carry)
