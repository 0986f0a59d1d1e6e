"""The states of a sale and what follows on what: one row per state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["FIRST", "LAST", "TABLE", "Row", "diagram"]


@dataclass(frozen=True, kw_only=True)
class Row:
    """One state: what is being done, in a sentence `... failed while <doing>`, and what follows.

    then: outcome → next state; the first one is the main flow. carries: an item is in the hand,
    so that losing it is an outcome, `dropped`. grasps: a failure here has a reason that may be
    gone at the next attempt.
    """

    doing: str
    then: Mapping[str, str]
    carries: bool = False
    grasps: bool = False


def _goal(doing: str, then: str) -> Row:
    return Row(doing=doing, then={"done": then, "failed": "stop"})


def _grasp(doing: str, then: str) -> Row:
    return Row(doing=doing, then={"done": then, "failed": "retry"}, grasps=True)


def _carry(doing: str, then: str) -> Row:
    return Row(doing=doing, then={"done": then, "failed": "stop", "dropped": "stop"}, carries=True)


FIRST = "order"
LAST = ("end", "failed")

TABLE: Mapping[str, Row] = {
    "order": Row(
        doing="choosing an item",
        then={"chosen": "tuck", "all_sold": "park", "sold_out": "stop", "unfit": "stop"},
    ),
    "tuck": _goal("tucking the arm in", "drive"),
    "drive": _goal("driving to the shelf", "open"),
    "open": _goal("opening the hand", "look"),
    "look": _goal("moving above its place", "find"),
    "find": Row(
        doing="looking for it",
        then={"found": "approach", "missing": "order", "blind": "stop"},
    ),
    "approach": _grasp("approaching it", "correct"),
    "correct": Row(
        doing="looking at it from near",
        then={"steady": "down", "moved": "shift", "missing": "retry", "blind": "stop"},
        grasps=True,
    ),
    "down": _grasp("going down", "close"),
    "close": _grasp("closing the hand", "check_grip"),
    "check_grip": Row(doing="grasping", then={"held": "lift", "not_held": "retry"}, grasps=True),
    "lift": _grasp("lifting", "check_lift"),
    "check_lift": Row(doing="lifting", then={"held": "retreat", "slipped": "retry"}, grasps=True),
    "retreat": _carry("taking it off the shelf", "check_height"),
    "check_height": Row(doing="lowering it", then={"safe": "reverse", "too_high": "lower"}),
    "reverse": _carry("driving back from the shelf", "home"),
    "home": _carry("driving home", "above"),
    "above": _carry("moving above the outlet", "place"),
    "place": _carry("placing it", "let_go"),
    "let_go": _goal("letting go of it", "up"),
    "up": _goal("leaving it in the outlet", "verify"),
    "verify": Row(doing="checking where it stands", then={"good": "order", "misplaced": "stop"}),
    "park": _goal("tucking the arm in after the last sale", "end"),
    "end": Row(doing="being done", then={}),
    "lower": _carry("lowering it", "check_height"),
    "shift": _grasp("following it", "correct"),
    "retry": Row(doing="trying again", then={"again": "release", "over": "stop"}),
    "release": _goal("letting go of it", "back_off"),
    "back_off": _goal("moving up", "look"),
    "stop": Row(doing="stopping", then={"rest": "failed", "restless": "failed"}),
    "failed": Row(doing="being stopped", then={}),
}


def diagram() -> str:
    """Return the table as text, one line per state; ↓ leads to the state below."""
    names = list(TABLE)
    below = dict(zip(names, [*names[1:], ""], strict=True))
    return "\n".join(_line(name, TABLE[name], below[name]) for name in names)


def _line(name: str, row: Row, below: str) -> str:
    ways = [f"{word} {'↓' if to == below else f'→ {to}'}" for word, to in row.then.items()]
    first, others = (ways or ["■"])[0], ways[1:]
    return f"{name:<13} {first:<20} {'   '.join(others)}".rstrip()
