"""What each state asks of the controller: one function per state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

from stepbus_schemas import Goal
from stepbus_schemas.messages import Point

from .geometry import Spot, hand_down, spot_of
from .sale import Shop

ODOMETRY = "odometry"
"""The frame of the poses: where the base was at the start."""

Maker = Callable[[Shop], Goal]


def tuck(shop: Shop) -> Goal:
    """Pull the arm in, so that the base may move."""
    joints = shop.settings.tuck
    return Goal(id=0, type="move_joints", joints=list(joints), values=list(joints.values()))


def drive(shop: Shop) -> Goal:
    """Drive in front of the item's column."""
    _, item = shop.now
    shelf = shop.shelf(item)
    column = shelf.left_of(item.position[0], item.position[1])
    return _go_to(shop, shelf.ahead(-shop.settings.stand, left=column))


def open_hand(shop: Shop) -> Goal:
    """Open the hand; the fingers leave the camera's view then."""
    return _grip(shop, shop.settings.grasp.opening)


def look(shop: Shop) -> Goal:
    """Move the open hand above the place where the item should be."""
    _, item = shop.now
    return _above(shop, item.top + shop.settings.heights.look)


def approach(shop: Shop) -> Goal:
    """Move above the item that was found."""
    return _above(shop, shop.grip_height() + shop.settings.heights.approach)


def shift(shop: Shop) -> Goal:
    """Follow the item at the same height."""
    height = shop.grip_height() + shop.settings.heights.approach
    return _pose(shop, "move_linear", shop.expected(), height)


def down(shop: Shop) -> Goal:
    """Go straight down, with the item between the open fingers."""
    return _pose(shop, "move_linear", shop.expected(), shop.grip_height(), slow=True)


def close(shop: Shop) -> Goal:
    """Close the hand on the item."""
    return _grip(shop, 0.0)


def lift(shop: Shop) -> Goal:
    """Lift the item straight up."""
    height = shop.grip_height() + shop.settings.heights.lift
    return _pose(shop, "move_linear", shop.expected(), height, slow=True)


def retreat(shop: Shop) -> Goal:
    """Take the item off the shelf, over the base, without lowering it."""
    sale, _ = shop.now
    return _pose(shop, "move_to_pose", _carried(shop), sale.tip)


def lower(shop: Shop) -> Goal:
    """Lower the item by one step."""
    sale, _ = shop.now
    heights = shop.settings.heights
    height = min(sale.tip, max(sale.tip - heights.step, heights.safe))
    return _pose(shop, "move_linear", _carried(shop), height)


def reverse(shop: Shop) -> Goal:
    """Drive back from the shelf, so that the base can turn."""
    way = -shop.settings.reverse
    return Goal(id=0, type="drive", by=way, touches=_touches(shop))


def home(shop: Shop) -> Goal:
    """Drive home with the item."""
    return _go_to(shop, shop.settings.home)


def above(shop: Shop) -> Goal:
    """Move the item above its spot in the outlet."""
    height = _placed_height(shop) + shop.settings.heights.approach
    return _pose(shop, "move_to_pose", _spot(shop), height)


def place(shop: Shop) -> Goal:
    """Put the item down on its spot."""
    return _pose(shop, "move_linear", _spot(shop), _placed_height(shop), slow=True)


def up(shop: Shop) -> Goal:
    """Leave the item where it is: straight up with the open hand."""
    _, item = shop.now
    # The fingers have to pass the neck of what they held.
    height = _placed_height(shop) + max(shop.settings.heights.approach, item.top - item.bottom)
    return _pose(shop, "move_linear", _spot(shop), height, slow=True)


def back_off(shop: Shop) -> Goal:
    """Move straight up from a failed attempt."""
    height = shop.grip_height() + shop.settings.heights.approach
    return _pose(shop, "move_linear", shop.expected(), height, slow=True)


def stop(_: Shop) -> Goal:
    """Bring base and arm to rest; the hand keeps what it holds."""
    return Goal(id=0, type="stop")


GOALS: Mapping[str, Maker] = {
    "tuck": tuck,
    "drive": drive,
    "open": open_hand,
    "look": look,
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
    "let_go": open_hand,
    "up": up,
    "park": tuck,
    "release": open_hand,
    "back_off": back_off,
    "stop": stop,
}
"""State → what it asks for; a state that is not here only looks."""


def _above(shop: Shop, height: float) -> Goal:
    return _pose(shop, "move_to_pose", shop.expected(), height)


def _pose(
    shop: Shop,
    kind: Literal["move_to_pose", "move_linear"],
    spot: Spot,
    height: float,
    *,
    slow: bool = False,
) -> Goal:
    """Return a goal for the hand that points down and opens along the spot's heading."""
    sale, _ = shop.now
    sale.tip = height
    position: Point = (spot.x, spot.y, height)
    return Goal(
        id=0,
        type=kind,
        tip=shop.settings.grasp.tip,
        frame=ODOMETRY,
        position=position,
        orientation=hand_down(spot.yaw),
        duration=shop.settings.grasp.down if slow else 0.0,
        touches=_touches(shop),
    )


def _go_to(shop: Shop, spot: Spot) -> Goal:
    return Goal(id=0, type="go_to", base=(spot.x, spot.y, spot.yaw), touches=_touches(shop))


def _grip(shop: Shop, width: float) -> Goal:
    force = shop.settings.grasp.force
    return Goal(id=0, type="grip", width=width, force=force, touches=_touches(shop))


_TOUCHING = (
    "down", "close", "lift", "retreat", "lower", "reverse", "home", "above", "release", "back_off",
)  # fmt: skip
_PLACING = ("place", "let_go", "up")


def _touches(shop: Shop) -> list[str]:
    """Return what may be touched: the item while it is gripped, the outlet while it is put down."""
    state = shop.visit.state
    if state not in _TOUCHING + _PLACING:
        return []
    _, item = shop.now
    return [item.name, shop.settings.outlet.link] if state in _PLACING else [item.name]


def _carried(shop: Shop) -> Spot:
    """Return where an item is carried: over the base, with the hand turned as the base is."""
    ahead, left = shop.settings.carry
    spot = spot_of(shop.seen.odometry).ahead(ahead, left)
    return _turned(shop, spot)


def _spot(shop: Shop) -> Spot:
    """Return the sale's spot in the outlet."""
    sale, _ = shop.now
    return _turned(shop, shop.settings.outlet.spot(sale.number - 1))


def _turned(shop: Shop, spot: Spot) -> Spot:
    return Spot(x=spot.x, y=spot.y, yaw=spot.yaw + shop.settings.grasp.yaw)


def _placed_height(shop: Shop) -> float:
    """Return the height of the tip where the item is let go of, just above the outlet [m]."""
    _, item = shop.now
    top = shop.settings.outlet.height + shop.settings.heights.drop
    return top + shop.grip_height() - item.bottom
