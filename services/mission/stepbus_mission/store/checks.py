"""When each state is over, and how it ended: one function per state."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from stepbus_participant.settings import nearest

from .detection import correct, find
from .geometry import tilt_of
from .report import Row
from .sale import Outcome, Sale, Shop
from .stock import Item

Check = Callable[[Shop], Outcome | None]
"""Returns how a state ended, or None while it goes on."""

HOPELESS = (
    "invalid", "limits", "no_answer", "no_force", "no_plan", "not_done", "not_holdable",
    "singular", "unreachable",
)  # fmt: skip
"""Causes that another attempt at the same item does not remove."""

_NO_WORD = "the controller does not answer"
_STANDS = 0.005
"""Velocity below which the base stands [m/s, rad/s]."""


def choose(shop: Shop) -> Outcome | None:
    """Take the next item: another one for the same order where one was missing."""
    settings = shop.settings
    if shop.sale is None:
        if shop.begun == len(settings.orders):
            return Outcome(word="all_sold")
        order = settings.orders[shop.begun]
        shop.begun += 1
        shop.sale = Sale(number=shop.begun, order=order, began_ns=shop.seen.t_ns)
    sale = shop.sale
    sale.item = _next_item(shop, sale)
    if sale.item is None:
        return Outcome(word="sold_out", cause="shelf_empty", why=_sold_out(shop, sale))
    sale.place, sale.attempts = None, 0
    return _fits(shop, sale.item)


def _next_item(shop: Shop, sale: Sale) -> Item | None:
    gone = {*shop.missing, *shop.sold}
    wanted = (
        item
        for item in shop.stock.items.values()
        if item.name not in gone and item.shelf and sale.order.item in {"", item.name}
    )
    kind = sale.order.kind
    return next((item for item in wanted if kind in {"", item.kind}), None)


def _sold_out(shop: Shop, sale: Sale) -> str:
    counts = f"{len(shop.sold)} sold, {len(shop.missing)} missing"
    if sale.order.item:
        return f"shelf empty, {sale.order.item} is not there; {counts}"
    kinds = shop.stock.kinds
    hint = "" if sale.order.kind in kinds else f"; {nearest(sale.order.kind, kinds)}"
    return f"shelf empty, nothing of kind {sale.order.kind} is left; {counts}{hint}"


def _fits(shop: Shop, item: Item) -> Outcome:
    yaw = shop.opening_yaw(item.yaw)
    width, opening = item.width_along(yaw), shop.settings.grasp.opening
    if width >= opening:
        why = f"too wide, {width:.3f} m, and the hand opens to {opening:.3f} m"
        return Outcome(word="unfit", cause="too_wide", why=why)
    shop.tell(f"goes for {item.name}")
    return Outcome(word="chosen")


def arrived(shop: Shop) -> Outcome | None:
    """Wait until the controller says that the goal is over."""
    status = shop.seen.status
    if lost := _dropped(shop):
        return lost
    if status is not None and status.state == "succeeded":
        return Outcome(word="done")
    if status is not None and status.state in {"failed", "cancelled"}:
        cause = status.cause or status.state
        return Outcome(word="failed", cause=cause, why=_phrase(cause, status.text))
    if status is not None and status.text and status.state == "running":
        _pass_on(shop, status.text)
    return _late(shop)


def _pass_on(shop: Shop, text: str) -> None:
    """Tell what the controller says on the way, as that it looks for another way."""
    if text != shop.visit.heard:
        shop.visit.heard = text
        shop.tell(text, "warning")


def _phrase(cause: str, text: str) -> str:
    """Return cause and text of a status, without saying the same twice."""
    said = cause.replace("_", " ")
    if not text or text.lower().startswith(said):
        return text or said
    return f"{said}, {text}"


def _late(shop: Shop) -> Outcome | None:
    """Return that the controller takes too long, to answer at all or to come to an end."""
    status, waits = shop.seen.status, shop.settings.waits
    goal = f"goal {shop.visit.goal} ({shop.visit.kind})"
    if status is None and shop.lasts >= waits.answer:
        why = f"{_NO_WORD}: {goal} has no status after {waits.answer:g} s; is it running?"
        return Outcome(word="failed", cause="no_answer", why=why)
    if status is not None and shop.lasts >= waits.motion:
        why = f"not done, {goal} is still {status.state} after {waits.motion:g} s"
        return Outcome(word="failed", cause="not_done", why=why)
    return None


def _dropped(shop: Shop) -> Outcome | None:
    """Return that the item was lost on the way, once that has lasted long enough."""
    if not shop.carries:
        return None
    sale, _ = shop.now
    if shop.seen.hand.holding:
        sale.lost_ns = None
        return None
    if sale.lost_ns is None:
        sale.lost_ns = shop.seen.t_ns
    if shop.since(sale.lost_ns) < shop.settings.waits.lost:
        return None
    why = f"dropped, width {shop.seen.hand.width:.3f} m"
    return Outcome(word="dropped", cause="dropped", why=why)


def check_grip(shop: Shop) -> Outcome | None:
    """Check that the closed hand holds something as wide as the item."""
    return _held(shop, "not_held", "not held")


def check_lift(shop: Shop) -> Outcome | None:
    """Check that the item has come up with the hand."""
    outcome = _held(shop, "slipped", "slipped")
    if outcome is not None and outcome.word == "held":
        hand = shop.seen.hand
        shop.tell(f"lifted, held with {hand.force:.1f} N at a width of {hand.width * 1e3:.1f} mm")
    return outcome


def _held(shop: Shop, word: str, text: str) -> Outcome | None:
    if shop.lasts < shop.settings.waits.still:
        return None
    _, item = shop.now
    hand, yaw = shop.seen.hand, shop.expected().yaw
    wanted = item.width_along(yaw)
    if hand.holding and hand.width >= wanted - shop.settings.grasp.width_tolerance:
        return Outcome(word="held")
    why = f"{text}, width {hand.width:.3f} m"
    if hand.holding:
        why += f" instead of {wanted:.3f} m"
    return Outcome(word=word, cause=word, why=why)


def check_height(shop: Shop) -> Outcome | None:
    """Compare the height of the tip with the safe one, before the base moves."""
    sale, _ = shop.now
    is_safe = sale.tip <= shop.settings.heights.safe
    return Outcome(word="safe" if is_safe else "too_high")


def retry(shop: Shop) -> Outcome | None:
    """Decide whether there is another attempt."""
    sale, _ = shop.now
    problem = shop.problem
    if problem is None:
        raise LookupError("nothing has gone wrong")
    attempts = shop.settings.attempts
    if problem.cause in HOPELESS:
        return Outcome(word="over")
    text = f"attempt {sale.attempts} of {attempts} failed while {shop.doing}: {problem.why}"
    shop.tell(text, "error")
    if sale.attempts < attempts:
        return Outcome(word="again")
    many = "attempt" if sale.attempts == 1 else "attempts"
    return Outcome(word="over", why=f"after {sale.attempts} {many}")


def verify(shop: Shop) -> Outcome | None:
    """Check with the plant's truth where the item stands, and that no other one was moved."""
    if shop.lasts < shop.settings.waits.rest:
        return None
    row = _measure(shop)
    fault = _fault(shop, row)
    if fault:
        return Outcome(word="misplaced", cause="misplaced", why=fault)
    shop.rows.append(row)
    shop.tell(f"placed {row.place_error * 1e3:.1f} mm from its spot after {row.duration:.1f} s")
    shop.sold.append(row.item)
    shop.stock.put(row.item, shop.seen.poses)
    shop.sale = None
    return Outcome(word="good")


def _measure(shop: Shop) -> Row:
    """Return the sale as a row of the report, from where things truly are now."""
    sale, item = shop.now
    x, y, _ = shop.stock.pose(item.name, shop.seen.poses)[0]
    spot = shop.settings.outlet.spot(sale.number - 1)
    return Row(
        number=sale.number,
        item=item.name,
        attempts=sale.attempts,
        detection_error=sale.found_off,
        place_error=math.hypot(x - spot.x, y - spot.y),
        moved=shop.stock.largest_move(shop.seen.poses, besides=item.name)[0],
        duration=shop.since(sale.began_ns),
    )


def _fault(shop: Shop, row: Row) -> str:
    """Return what is wrong with where things are; empty: nothing."""
    allowed = shop.settings.tolerances
    _, item = shop.now
    position, turn = shop.stock.pose(item.name, shop.seen.poses)
    raised = position[2] + item.measures.bottom - shop.settings.outlet.height
    if row.place_error > allowed.placed:
        return f"misplaced, {row.place_error * 1e3:.1f} mm from its spot"
    if tilt_of(turn) > allowed.tilt:
        return f"not upright, tilted by {math.degrees(tilt_of(turn)):.0f}°"
    if abs(raised) > allowed.placed:
        return f"misplaced, its bottom is {raised * 1e3:.1f} mm above the top of the outlet"
    if row.moved > allowed.moved:
        other = shop.stock.largest_move(shop.seen.poses, besides=item.name)[1]
        return f"{other} was moved by {row.moved * 1e3:.1f} mm"
    return ""


def at_rest(shop: Shop) -> Outcome | None:
    """Wait until the arm has come to rest and the base has stood for a while."""
    visit, waits = shop.visit, shop.settings.waits
    base = shop.seen.odometry
    stands = max(abs(base.vx), abs(base.wz)) < _STANDS
    is_still = stands and shop.seen.status is not None and shop.seen.status.state == "succeeded"
    if not is_still:
        visit.since_ns = None
    elif visit.since_ns is None:
        visit.since_ns = shop.seen.t_ns
    if visit.since_ns is not None and shop.since(visit.since_ns) >= waits.rest:
        shop.rest = "everything stands still"
        return Outcome(word="rest")
    if shop.lasts < waits.halt:
        return None
    shop.rest = f"not at rest after {waits.halt:g} s, {_restless(shop)}"
    return Outcome(word="restless")


def _restless(shop: Shop) -> str:
    base, status = shop.seen.odometry, shop.seen.status
    if max(abs(base.vx), abs(base.wz)) >= _STANDS:
        return f"the base moves with {base.vx:.3f} m/s and {base.wz:.3f} rad/s"
    if status is None:
        return _NO_WORD
    return f"the controller says {status.state}" + (f", {status.text}" if status.text else "")


CHECKS: Mapping[str, Check] = {
    "order": choose,
    "find": find,
    "correct": correct,
    "check_grip": check_grip,
    "check_lift": check_lift,
    "check_height": check_height,
    "verify": verify,
    "retry": retry,
    "stop": at_rest,
}
"""State → its own check; the others are over when the controller says so."""


def check_of(state: str) -> Check:
    """Return the check of a state."""
    return CHECKS.get(state, arrived)
