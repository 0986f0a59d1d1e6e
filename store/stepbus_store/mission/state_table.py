"""The states of the mission: what each does, and which state follows on which outcome."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class State:
    """One state.

    doing: its activity, as in `... failed while <doing>`. then: outcome → next state; the first
    one is the nominal flow. carries: the gripper carries an item; losing it is the outcome
    `dropped`. looks: it needs images.
    """

    doing: str
    then: Mapping[str, str]
    carries: bool = False
    looks: bool = False


def _ending(**failures: str) -> Callable[[str, str], State]:
    """Return a maker of states from what each does, and the state after it; failures: others."""
    carries = "dropped" in failures
    return lambda doing, then: State(doing=doing, then={"done": then, **failures}, carries=carries)


_goal = _ending(failed="stop")
_grasp = _ending(failed="retry")
_trip = _ending(failed="stop", blocked="fold_again")
_carry = _ending(failed="stop", dropped="stop")
_bring = _ending(failed="stop", dropped="stop", blocked="withdraw")

FIRST = "order"
LAST = ("end", "failed")

STATES: Mapping[str, State] = {
    "order": State(
        doing="choosing an item",
        then={
            "chosen": "tuck",
            "together": "depart",
            "skipped": "order",
            "all_sold": "park",
            "nothing_sold": "stop",
        },
    ),
    "tuck": _goal("tucking the arm in", "drive"),
    "drive": _trip("driving to the shelf", "open"),
    "open": _goal("opening the gripper", "inspect"),
    "inspect": _goal("moving above its position", "find"),
    "find": State(
        doing="searching for it",
        then={"found": "approach", "missing": "order", "blind": "stop"},
        looks=True,
    ),
    "approach": _grasp("approaching it", "correct"),
    "correct": State(
        doing="locating it from close up",
        then={"steady": "check_width", "moved": "shift", "missing": "retry", "blind": "stop"},
        looks=True,
    ),
    "check_width": State(doing="opening", then={"wide": "down", "too_wide": "narrow"}),
    "narrow": _grasp("opening less", "down"),
    "down": _grasp("moving down", "close"),
    "close": _grasp("closing the gripper", "check_grip"),
    "check_grip": State(doing="grasping", then={"held": "lift", "not_held": "retry"}),
    "lift": _grasp("lifting", "check_lift"),
    "check_lift": State(
        doing="lifting", then={"held": "retreat", "slipped": "retry", "together": "return"}
    ),
    "retreat": _carry("taking it off the shelf", "check_height"),
    "check_height": State(doing="lowering it", then={"safe": "reverse", "too_high": "lower"}),
    "reverse": _carry("driving back from the shelf", "home"),
    "home": _bring("driving home", "above"),
    "above": _carry("moving above the outlet", "aim"),
    "aim": State(
        doing="locating the outlet",
        then={"aimed": "place", "dropped": "stop"},
        carries=True,
        looks=True,
    ),
    "place": _carry("placing it", "let_go"),
    "let_go": _goal("releasing it", "up"),
    "up": _goal("leaving it in the outlet", "verify"),
    "verify": State(
        doing="verifying its pose", then={"good": "order", "misplaced": "stop"}, looks=True
    ),
    "park": State(
        doing="tucking the arm in after the last sale",
        then={"done": "end", "stays": "halt", "failed": "stop"},
    ),
    "end": State(doing="being done", then={}),
    "lower": _carry("lowering it", "check_height"),
    "halt": State(
        doing="stopping after the last sale",
        then={"rest": "end", "recover": "end", "restless": "stop"},
    ),
    "depart": _goal("driving to the shelf", "fold"),
    "fold": _trip("tucking the arm in", "ready"),
    "ready": _trip("opening the gripper", "reach"),
    "reach": _trip("moving above its position", "arrive"),
    "arrive": _trip("driving to the shelf", "find"),
    "return": _goal("driving home", "draw_in"),
    "draw_in": _bring("taking it off the shelf", "bring"),
    "bring": _bring("moving above the outlet", "come_home"),
    "come_home": _bring("driving home", "aim"),
    "shift": _grasp("following it", "correct"),
    "retry": State(
        doing="trying again", then={"again": "release", "other": "approach", "over": "stop"}
    ),
    "release": _goal("releasing it", "back_off"),
    "back_off": _goal("moving up", "inspect"),
    "withdraw": _carry("drawing the arm in", "home"),
    "fold_again": _goal("tucking the arm in", "drive"),
    "stop": State(
        doing="stopping", then={"rest": "failed", "restless": "failed", "recover": "recover"}
    ),
    "recover": State(doing="going back to rest", then={"done": "failed", "failed": "failed"}),
    "failed": State(doing="being stopped", then={}),
}


BESIDE = {
    **dict.fromkeys(("fold", "ready", "reach", "arrive"), "depart"),
    **dict.fromkeys(("draw_in", "bring", "come_home"), "return"),
}
"""State beside a base that drives → the state that sends the base off."""

TRIPS = {**{state: state for state in ("depart", "return", "drive", "home")}, **BESIDE}
"""State while the base drives → likewise."""
