"""Decides when each state ends, and with which outcome: one function per state."""

from collections.abc import Callable, Mapping

from stepbus_schemas import GoalStatus
from stepbus_store.cause import Cause
from stepbus_store.mission.inventory import Item
from stepbus_store.mission.report import Unsold
from stepbus_store.mission.rest import NO_ANSWER, at_rest
from stepbus_store.mission.state import APPROACHES, Outcome, Sale, StoreState
from stepbus_store.mission.state_table import BESIDE, STATES
from stepbus_store.mission.verification import aim, correct, find, verify

Check = Callable[[StoreState], Outcome | None]
"""Returns the outcome of a state, or None while the state continues."""

HOPELESS = (
    Cause.ARM_JAMMED, Cause.INVALID, Cause.LIMITS, Cause.NO_ANSWER, Cause.NO_PLAN,
    Cause.NOT_DONE, Cause.NOT_HOLDABLE, Cause.NOT_SETTLED, Cause.SINGULAR, Cause.TILTED,
    Cause.UNREACHABLE,
)  # fmt: skip
"""Causes that another attempt at the same item does not remove."""

REFUSED = (
    Cause.BLOCKED, Cause.LIMITS, Cause.NO_PATH, Cause.NOT_HOLDABLE, Cause.SINGULAR,
    Cause.UNREACHABLE,
)  # fmt: skip
"""Causes that another approach to the item may remove."""

PLANNABLE = ("approach", "shift", "lift", "lower", "place", "up", "back_off")
"""States for whose straight line a planned path may stand."""

CURABLE = (Cause.BLOCKED, Cause.LIMITS, Cause.SINGULAR)
"""Causes for which no straight line may lead where a planned path does."""

_APPROACHING = ("approaching it", "following it", "opening less", "moving down")
"""Activities before the gripper has closed."""

_SAME_WIDTH = 1e-3
"""Difference of two openings that need no motion of the fingers [m]."""


def choose(store: StoreState) -> Outcome | None:
    """Choose the next item: another one for the same order if the last one was missing.

    An order that cannot be fulfilled is left out, unless it is the last one and nothing was sold.
    """
    settings = store.settings
    if store.sale is None:
        if store.started == len(settings.orders):
            return Outcome(name="all_sold")
        order = settings.orders[store.started]
        store.started += 1
        store.sale = Sale(number=store.started, order=order, start_ns=store.inputs.t_ns)
    sale = store.sale
    sale.item = _next_item(store, sale)
    if sale.item is None:
        return _leave_out(store, sale, Cause.SHELF_EMPTY, _sold_out(store, sale))
    sale.detected, sale.attempts, sale.tries, sale.asides = None, 0, 0, 0
    problem = _misfit(store, sale.item)
    if problem:
        return _leave_out(store, sale, Cause.TOO_WIDE, problem)
    store.report(f"fetching {sale.item.name}")
    return Outcome(name="together" if settings.together else "chosen")


def _leave_out(store: StoreState, sale: Sale, cause: Cause, text: str) -> Outcome:
    """Go on to the next order, if there is one or something was sold."""
    store.unsold.append(Unsold(number=sale.number, order=str(sale.order), reason=text))
    if not store.results and store.started == len(store.settings.orders):
        return Outcome(name="nothing_sold", cause=cause, text=text)
    store.report(text, "warning")
    store.sale = None
    return Outcome(name="skipped")


def _next_item(store: StoreState, sale: Sale) -> Item | None:
    order, unavailable = sale.order, {*store.missing, *store.sold}
    for item in store.stock.items.values():
        is_ordered = order.item in {"", item.name} and order.type in {"", item.type}
        if is_ordered and item.shelf and item.name not in unavailable:
            return item
    return None


def _sold_out(store: StoreState, sale: Sale) -> str:
    missing, item = list(store.missing.values()), sale.order.item
    counts = f"{len(store.sold)} sold, {missing.count(Cause.MISSING)} missing"
    for why in (Cause.LYING, Cause.HIDDEN):
        if count := missing.count(why):
            counts += f", {count} {why}"
    if item:
        found = store.missing.get(item, Cause.MISSING)
        there = "is not there" if found == Cause.MISSING else f"is {found}"
        return f"shelf empty, {item} {there}; {counts}"
    return f"shelf empty, no {sale.order.type} is left; {counts}"


def _misfit(store: StoreState, item: Item) -> str:
    """Return why an item does not fit into the open gripper; empty: it does."""
    width, opening = item.width_along(store.opening_yaw(item.yaw)), store.settings.opening
    if width < opening:
        return ""
    return f"too wide, {width:.3f} m, and the gripper opens to {opening:.3f} m"


def arrived(store: StoreState) -> Outcome | None:
    """Wait until the controller reports the end of the goal."""
    status = store.inputs.status
    if ended := _dropped(store) or _trip_failed(store):
        return ended
    if status is None:
        return _timeout(store)
    if status.state == "succeeded":
        if status.cause:
            store.report(f"{STATES[store.visit.state].doing} {status.text.partition('; ')[0]}")
        return Outcome(name="done")
    if status.state in {"failed", "cancelled"}:
        return _failed(status)
    if status.state == "running" and status.text not in ("", store.visit.last_text):
        # Such as a search for another path.
        store.visit.last_text = status.text
        store.report(status.text, "warning")
    return _timeout(store)


def departed(store: StoreState) -> Outcome | None:
    """Wait until the controller has taken the goal of the base; others follow beside it."""
    status = store.inputs.status
    if status is not None and status.state in {"accepted", "running"}:
        return Outcome(name="done")
    return arrived(store)


def landed(store: StoreState) -> Outcome | None:
    """Wait until the base has arrived, beside which others were carried out."""
    if ended := _dropped(store) or _trip_failed(store):
        return ended
    trip = store.inputs.trip
    if trip is not None and trip.state == "succeeded":
        return Outcome(name="done")
    longest = store.settings.waits.motion
    if store.elapsed < longest:
        return None
    text = f"not done, goal {store.trip} (go_together) goes on after {longest:g} s"
    return Outcome(name="failed", cause=Cause.NOT_DONE, text=text)


def _trip_failed(store: StoreState) -> Outcome | None:
    """Return a failure if the base's goal has failed while others are carried out beside it."""
    trip = store.inputs.trip
    if trip is None or store.visit.state not in BESIDE:
        return None
    if trip.state == "running" and trip.text and trip.text != store.trip_text:
        store.trip_text = trip.text
        store.report(trip.text, "warning")
    return _failed(trip, store.trip_doing) if trip.state in {"failed", "cancelled"} else None


def _failed(status: GoalStatus, doing: str = "") -> Outcome:
    """Return how a goal has failed, with cause and text without repeating the cause."""
    cause, text = status.cause or status.state, status.text
    words = cause.replace("_", " ")
    if not text.lower().startswith(words):
        text = f"{words}, {text}" if text else words
    return Outcome(name="failed", cause=cause, text=text, doing=doing)


def _timeout(store: StoreState) -> Outcome | None:
    """Return a failure if the controller takes too long to answer or to reach the goal."""
    status, waits = store.inputs.status, store.settings.waits
    goal = f"goal {store.visit.goal} ({store.visit.goal_type})"
    if status is None and store.elapsed >= waits.answer:
        text = f"{NO_ANSWER}: {goal} has no status after {waits.answer:g} s; is it running?"
        return Outcome(name="failed", cause=Cause.NO_ANSWER, text=text)
    if status is not None and store.elapsed >= waits.motion:
        text = f"not done, {goal} is still {status.state} after {waits.motion:g} s"
        return Outcome(name="failed", cause=Cause.NOT_DONE, text=text)
    return None


def _dropped(store: StoreState) -> Outcome | None:
    """Return a failure if the carried item has not been held for long enough."""
    if not STATES[store.visit.state].carries:
        return None
    sale, gripper = store.now[0], store.inputs.gripper
    if gripper.holding:
        sale.lost_ns = None
        return None
    if sale.lost_ns is None:
        sale.lost_ns = store.inputs.t_ns
    if store.since(sale.lost_ns) < store.settings.waits.lost:
        return None
    text = f"dropped, width {gripper.width:.3f} m"
    return Outcome(name="dropped", cause=Cause.DROPPED, text=text)


def check_lift(store: StoreState) -> Outcome | None:
    """Check that the gripper has lifted the item."""
    outcome = _held(store, Cause.SLIPPED, "slipped")
    if outcome is None or outcome.name != "held":
        return outcome
    force, width = store.inputs.gripper.force, store.inputs.gripper.width * 1e3
    store.now[0].asides = 0
    store.report(f"lifted, held with {force:.1f} N at a width of {width:.1f} mm")
    return Outcome(name="together") if store.settings.together else outcome


def _held(store: StoreState, cause: Cause, text: str) -> Outcome | None:
    """Check that the closed gripper holds something as wide as the item."""
    if store.elapsed < store.settings.waits.grip:
        return None
    gripper, expected = store.inputs.gripper, store.item.width_along(store.expected().yaw)
    if gripper.holding and gripper.width >= expected - store.settings.width_tolerance:
        return Outcome(name="held")
    text = f"{text}, width {gripper.width:.3f} m"
    if gripper.holding:
        text += f" instead of {expected:.3f} m"
    return Outcome(name=cause, cause=cause, text=text)


def check_height(store: StoreState) -> Outcome | None:
    """Check that the tip is low enough for the base to move."""
    is_safe = store.now[0].tip <= store.settings.safe_height
    return Outcome(name="safe" if is_safe else "too_high")


def retry(store: StoreState) -> Outcome | None:
    """Decide whether to try again."""
    sale, _ = store.now
    problem = store.problem
    if problem is None:
        raise LookupError("nothing has gone wrong")
    if store.doing in _APPROACHING and problem.cause in REFUSED:
        return _other_approach(store, problem)
    attempts = store.settings.attempts
    # Fingers that have not left the width at which they came do not move.
    is_stuck = store.inputs.gripper.width > store.opening() - _SAME_WIDTH
    if problem.cause in HOPELESS or (problem.cause == Cause.STUCK and is_stuck):
        return Outcome(name="over")
    text = f"attempt {sale.attempts} of {attempts} failed while {store.doing}: {problem.text}"
    store.report(text, "error")
    if sale.attempts < attempts:
        sale.tries += 1
        return Outcome(name="again")
    many = "attempt" if sale.attempts == 1 else "attempts"
    return Outcome(name="over", text=f"after {sale.attempts} {many}")


def _other_approach(store: StoreState, problem: Outcome) -> Outcome:
    """Take the next approach that the item fits into, if there is one."""
    sale, item = store.now
    text = f"{sale.approach.text}: {problem.text}"
    while sale.tries + 1 < len(APPROACHES):
        sale.tries += 1
        if not _misfit(store, item):
            store.report(f"{text}; next, {sale.approach.text}", "warning")
            return Outcome(name="other")
    return Outcome(name="over", text=f"after {len(APPROACHES)} approaches")


def check_width(store: StoreState) -> Outcome | None:
    """Check that the gripper is open no wider than the approach wants it."""
    is_wide = store.now[0].opening > store.opening() + _SAME_WIDTH
    return Outcome(name="too_wide" if is_wide else "wide")


def recovered(store: StoreState) -> Outcome | None:
    """Wait until the arm is back at rest, or until there is no way."""
    outcome = arrived(store)
    if outcome is not None:
        is_back = outcome.name == "done"
        store.rest += "; the arm is back at rest" if is_back else f"; {outcome.text}"
    return outcome


def parked(store: StoreState) -> Outcome | None:
    """Wait until the arm is tucked in; where there is no way, everything is sold nevertheless."""
    outcome = arrived(store)
    if outcome is None or outcome.cause not in (Cause.NO_PATH, Cause.BLOCKED):
        return outcome
    doing = STATES[store.visit.state].doing
    store.log.append(("warning", f"{doing}: {outcome.text}; the arm stays where it is"))
    return Outcome(name="stays")


CHECKS: Mapping[str, Check] = {
    "order": choose,
    "find": find,
    "correct": correct,
    "aim": lambda store: _dropped(store) or aim(store),
    "check_width": check_width,
    "check_grip": lambda store: _held(store, Cause.NOT_HELD, "not held"),
    "check_lift": check_lift,
    "check_height": check_height,
    "depart": departed,
    "return": departed,
    "arrive": landed,
    "come_home": landed,
    "verify": verify,
    "park": parked,
    "halt": at_rest,
    "retry": retry,
    "stop": at_rest,
    "recover": recovered,
}
"""State → its check; the others have `arrived`."""
