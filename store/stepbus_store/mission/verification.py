"""What the mission sees at the shelf: it looks for the item, and verifies what it holds."""

import math

from stepbus_participant import suggest
from stepbus_schemas import Detections, Point, RunError
from stepbus_store.cause import Cause
from stepbus_store.mission.geometry import Spot, spot_of, tilt_of
from stepbus_store.mission.report import SaleResult
from stepbus_store.mission.state import Outcome, StoreState
from stepbus_store.mission.state_goals import ODOMETRY
from stepbus_store.mission.state_table import STATES
from stepbus_store.poses import yaw_of

_AIMS = 2
"""Views of the outlet before an item is put down: the second one is corrected by the first."""

_LIES = math.radians(45.0)
"""Tilt from which an item that is seen lies."""

_HIDDEN = 0.5
"""Share of an item's place that something else hides, from which the view says nothing of it."""

_AGAIN = 0.2
"""After so long without an answer, another image is asked for [s]."""


def wants_image(store: StoreState) -> bool:
    """Return whether the state waits for an image that it has not asked for."""
    visit = store.visit
    if not STATES[visit.state].looks or store.elapsed < store.settings.waits.still:
        return False
    if visit.asked_ns is None or store.inputs.detections is not None:
        return True
    return store.since(visit.asked_ns) >= _AGAIN


def looked_at(store: StoreState) -> Point | None:
    """Return where the top of the item is expected, in the base's frame [m]; None: nowhere."""
    state = store.visit.state
    if state not in ("find", "correct", "verify"):
        return None
    item, spot, height = store.item, store.expected(), store.item.top
    if state == "verify":
        spot = store.in_odometry(store.outlet_spot())
        height = store.settings.outlet.position[2] + item.top - item.bottom
    ahead, left = spot_of(store.inputs.odometry).sees(spot.x, spot.y)
    return (ahead, left, height)


def find(store: StoreState) -> Outcome | None:
    """Locate the item near its expected position."""
    sale, item = store.now
    spot = _locate(store)
    if isinstance(spot, Outcome):
        if spot.name == "missing":
            store.missing[item.name] = spot.cause
            store.report(spot.text, "warning")
        return spot
    if spot is None:
        return None
    off = _distance(spot, store.expected())
    store.report(f"found {item.name}, {off * 1e3:.1f} mm from where it was expected")
    sale.detected, sale.corrections = spot, 0
    sale.attempts += 1
    return Outcome(name="found")


def aim(store: StoreState) -> Outcome | None:
    """Wait above the outlet until its landmarks have corrected the pose of the base."""
    visit, waits = store.visit, store.settings.waits
    if store.inputs.pose is None:
        return Outcome(name="aimed")
    if store.elapsed >= waits.still and store.inputs.detections is not None:
        visit.views += 1
    if visit.views < _AIMS and store.elapsed < waits.camera:
        return None
    if visit.views < _AIMS:
        store.report(f"the camera shows nothing above the outlet for {waits.camera:g} s", "warning")
    return Outcome(name="aimed")


def correct(store: StoreState) -> Outcome | None:
    """Locate the item again from close up, until it is below the gripper."""
    sale, item = store.now
    spot = _locate(store)
    if spot is None or isinstance(spot, Outcome):
        return spot
    off = _distance(spot, store.expected())
    if store.settings.verification == "truth":
        truth = store.stock.pose(item.name, store.inputs.poses)[0]
        sale.detection_error = math.hypot(spot.x - truth[0], spot.y - truth[1])
    sale.detected = spot
    if off < store.settings.tolerances.steady:
        return Outcome(name="steady")
    if sale.corrections == store.settings.corrections:
        text = f"still seen {off * 1e3:.1f} mm away after {sale.corrections} corrections"
        store.report(text, "warning")
        return Outcome(name="steady")
    sale.corrections += 1
    return Outcome(name="moved")


def _locate(store: StoreState) -> Spot | Outcome | None:
    """Return the item's detected position, with the heading along which the gripper opens.

    An outcome: it is missing, or there was no image; None: wait for the next image.
    """
    detections = _view(store, "shelf", "blind")
    if not isinstance(detections, Detections):
        return detections
    if seen := nearest(store, detections, store.expected()):
        return seen[0]
    return _missing(store, detections) if store.visit.views == store.settings.views else None


def _view(store: StoreState, where: str, blind: str) -> Detections | Outcome | None:
    """Return new detections above the shelf or outlet; None: wait for the next image.

    blind: name of the outcome where there was no image for too long.
    """
    visit, waits = store.visit, store.settings.waits
    if store.elapsed < waits.still:
        return None
    if store.inputs.detections is None:
        if store.elapsed < waits.camera * (1 + visit.views):
            return None
        text = f"the camera shows nothing: no detections for {waits.camera:g} s above the {where}"
        return Outcome(name=blind, cause=Cause.BLIND, text=text)
    visit.views += 1
    return store.inputs.detections


def nearest(
    store: StoreState, detections: Detections, expected: Spot, *, lies: bool = False
) -> tuple[Spot, float] | None:
    """Return the detection of the item's type nearest to a spot, and the height of its centre [m].

    None: none that stands is near enough. lies: look for one that lies.
    """
    item = store.item
    rows = zip(detections.types, detections.position, detections.orientation, strict=True)
    spots = [
        (_in_odometry(store, detections.frame, position, yaw_of(orientation)), position[2])
        for item_type, position, orientation in rows
        if item_type == item.type and (tilt_of(orientation) > _LIES) == lies
    ]
    seen = min(spots, key=lambda row: _distance(row[0], expected), default=None)
    # What has toppled has its middle half its height away.
    near = store.settings.tolerances.found + ((item.top - item.bottom) / 2 if lies else 0.0)
    return None if seen is None or _distance(seen[0], expected) > near else seen


def _distance(a: Spot, b: Spot) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def _in_odometry(store: StoreState, frame: str, position: Point, yaw: float) -> Spot:
    """Return a detection in the odometry frame; raises RunError for an unknown frame."""
    if frame in {ODOMETRY, "world"}:
        return Spot(x=position[0], y=position[1], yaw=yaw)
    if frame != store.settings.base_frame:
        known = [store.settings.base_frame, ODOMETRY]
        raise RunError(f"detections have the unknown frame {frame!r}{suggest(frame, known)}")
    base = spot_of(store.inputs.odometry)
    spot = base.ahead(position[0], left=position[1])
    return Spot(x=spot.x, y=spot.y, yaw=base.yaw + yaw)


def _missing(store: StoreState, detections: Detections) -> Outcome:
    """Return why the item cannot be taken: it lies, something hides it, or it is not there."""
    item, near = store.item, store.settings.tolerances.found * 1e3
    expected, views = store.expected(), f"in {store.visit.views} views"
    if lying := nearest(store, detections, expected, lies=True):
        off = _distance(lying[0], expected) * 1e3
        text = f"{item.name} lies {off:.0f} mm from where it should stand"
        return Outcome(name="missing", cause=Cause.LYING, text=f"lying, {text}")
    if detections.hidden > _HIDDEN:
        text = f"something hides {detections.hidden:.0%} of where {item.name} should be {views}"
        return Outcome(name="missing", cause=Cause.HIDDEN, text=f"hidden, {text}")
    seen = ", ".join(t for t in dict.fromkeys(detections.types) if t in store.stock.types)
    where = f"within {near:g} mm of where {item.name} should be {views}"
    text = f"missing, no {item.type} {where}; seen: {seen or 'nothing'}"
    return Outcome(name="missing", cause=Cause.MISSING, text=text)


def verify(store: StoreState) -> Outcome | None:
    """Check where the item stands, and that no other item was moved, as far as that is seen."""
    if store.witness is None:
        return _verify_by_camera(store)
    if store.elapsed < store.settings.waits.rest:
        return None
    item, settings, poses = store.item, store.settings, store.inputs.poses
    allowed, spot = settings.tolerances, store.outlet_spot()
    (x, y, z), turn = store.stock.pose(item.name, poses)
    away = math.hypot(x - spot.x, y - spot.y)
    moved, other = store.witness.largest(poses, item.name)
    fault = _off(store, away, z + item.measures.bottom - settings.outlet.position[2])
    if tilt_of(turn) > allowed.tilt and away <= allowed.placed:
        fault = f"not upright, tilted by {math.degrees(tilt_of(turn)):.0f}°"
    elif not fault and moved > allowed.moved:
        fault = f"{other} was moved by {moved * 1e3:.1f} mm"
    return _conclude(store, away, fault, moved)


def _verify_by_camera(store: StoreState) -> Outcome | None:
    """Check the placement by the camera, which also sees the landmarks of the outlet."""
    item, settings = store.item, store.settings
    detections = _view(store, "outlet", "misplaced")
    if not isinstance(detections, Detections):
        return detections
    spot = store.in_odometry(store.outlet_spot())
    seen = nearest(store, detections, spot)
    if seen is None:
        if store.visit.views < settings.views:
            return None
        near = settings.tolerances.found * 1e3
        text = f"no upright {item.type} is seen within {near:g} mm of its spot"
        if nearest(store, detections, spot, lies=True) is not None:
            text += "; one lies there"
        elif detections.hidden > _HIDDEN:
            text += f"; something hides {detections.hidden:.0%} of that"
        return Outcome(name="misplaced", cause=Cause.MISPLACED, text=f"misplaced, {text}")
    at, height = seen
    away = _distance(at, spot)
    raised = height - (item.top - item.bottom) / 2 - settings.outlet.position[2]
    return _conclude(store, away, _off(store, away, raised))


def _off(store: StoreState, away: float, raised: float) -> str:
    """Return that an item is too far from its spot, or above the outlet [m]; empty: it is not."""
    allowed = store.settings.tolerances.placed
    if away > allowed:
        return f"misplaced, {away * 1e3:.1f} mm from its spot"
    if abs(raised) > allowed:
        return f"misplaced, its bottom is {raised * 1e3:.1f} mm above the top of the outlet"
    return ""


def _conclude(
    store: StoreState, place_error: float, fault: str, moved: float | None = None
) -> Outcome:
    """End the sale; fault: what is wrong with the placement; empty: nothing."""
    if fault:
        return Outcome(name="misplaced", cause=Cause.MISPLACED, text=fault)
    sale, item = store.now
    result = SaleResult(
        number=sale.number,
        item=item.name,
        attempts=sale.attempts,
        detection_error=sale.detection_error,
        place_error=place_error,
        moved=moved,
        duration=store.since(sale.start_ns),
    )
    store.results.append(result)
    store.report(f"placed {place_error * 1e3:.1f} mm from its spot after {result.duration:.1f} s")
    store.sold.append(item.name)
    store.stock.update(item.name, store.inputs.poses)
    if store.witness is not None:
        store.witness.settle(item.name, store.inputs.poses)
    store.sale = None
    return Outcome(name="good")
