"""Locates the item with the camera: from above the shelf, then from close up."""

import math

from stepbus_participant import suggest
from stepbus_schemas import Detections, Point, RunError

from .geometry import Spot, spot_of, yaw_of
from .goals import ODOMETRY
from .state import Outcome, StoreState


def find(store: StoreState) -> Outcome | None:
    """Locate the item near its expected position."""
    sale, item = store.now
    spot = _locate(store)
    if isinstance(spot, Outcome):
        if spot.name == "missing":
            store.missing.append(item.name)
            store.report(spot.text, "warning")
        return spot
    if spot is not None:
        off = _distance(spot, store.expected())
        store.report(f"found {item.name}, {off * 1e3:.1f} mm from where it was expected")
        sale.detected, sale.corrections = spot, 0
        sale.attempts += 1
        return Outcome(name="found")
    return None


def correct(store: StoreState) -> Outcome | None:
    """Locate the item again from close up, until it is below the gripper."""
    sale, item = store.now
    spot = _locate(store)
    if spot is None or isinstance(spot, Outcome):
        return spot
    off = _distance(spot, store.expected())
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
    visit, waits = store.visit, store.settings.waits
    if store.elapsed < waits.still:
        return None
    if store.inputs.detections is None:
        if store.elapsed < waits.camera or visit.views:
            return None
        text = f"the camera shows nothing: no detections for {waits.camera:g} s above the shelf"
        return Outcome(name="blind", cause="blind", text=text)
    visit.views += 1
    spot = _nearest(store, store.inputs.detections)
    if spot is None and visit.views == store.settings.views:
        return Outcome(
            name="missing", cause="missing", text=_missing(store, store.inputs.detections)
        )
    return spot


def _nearest(store: StoreState, found: Detections) -> Spot | None:
    """Return the nearest detection of the item's type, if it is near enough."""
    _, item = store.now
    expected = store.expected()
    _check(found)
    spots = [
        _in_odometry(store, found.frame, position, yaw_of(orientation))
        for item_type, position, orientation in zip(
            found.types, found.position, found.orientation, strict=True
        )
        if item_type == item.type
    ]
    spot = min(spots, key=lambda spot: _distance(spot, expected), default=None)
    if spot is None or _distance(spot, expected) > store.settings.tolerances.found:
        return None
    return spot


def _check(found: Detections) -> None:
    """Raise RunError for inconsistent detections and for poses that are not finite."""
    counts = (len(found.types), len(found.position), len(found.orientation))
    if len(set(counts)) > 1:
        types, positions, orientations = counts
        raise RunError(
            f"detections have {types} types, {positions} positions, {orientations} orientations"
        )
    for name, position, turn in zip(found.types, found.position, found.orientation, strict=True):
        if not math.isfinite(sum(position) + sum(turn)):
            raise RunError(f"{name} has an invalid pose: position {position}, orientation {turn}")


def _distance(a: Spot, b: Spot) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def _in_odometry(store: StoreState, frame: str, position: Point, yaw: float) -> Spot:
    """Return a detection in the odometry frame; raises RunError for an unknown frame."""
    if frame in {ODOMETRY, "world"}:
        return Spot(x=position[0], y=position[1], yaw=yaw)
    if frame != store.settings.base_frame:
        known = [store.settings.base_frame, ODOMETRY]
        raise RunError(f"detections are given in frame {frame!r}{suggest(frame, known)}")
    base = spot_of(store.inputs.odometry)
    spot = base.ahead(position[0], left=position[1])
    return Spot(x=spot.x, y=spot.y, yaw=base.yaw + yaw)


def _missing(store: StoreState, found: Detections) -> str:
    _, item = store.now
    near = store.settings.tolerances.found * 1e3
    types = ", ".join(dict.fromkeys(found.types)) or "nothing"
    return (
        f"missing, no {item.type} within {near:g} mm of where {item.name} should be in "
        f"{store.visit.views} views; seen: {types}"
    )
