"""Locates the item with the camera: from above the shelf, then from close up."""

import math

from stepbus_participant import suggest
from stepbus_schemas import Detections, Point, RunError
from stepbus_store.mission.geometry import Spot, spot_of, yaw_of

from .goals import ODOMETRY
from .state import Outcome, StoreState

_AIMS = 2
"""Views of the outlet before an item is put down: the second one is corrected by the first."""


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
    visit, waits = store.visit, store.settings.waits
    if store.elapsed < waits.still:
        return None
    if store.inputs.detections is None:
        if store.elapsed < waits.camera * (1 + visit.views):
            return None
        text = f"the camera shows nothing: no detections for {waits.camera:g} s above the shelf"
        return Outcome(name="blind", cause="blind", text=text)
    visit.views += 1
    seen = nearest(store, store.inputs.detections, store.expected())
    if seen is None and visit.views == store.settings.views:
        return Outcome(
            name="missing", cause="missing", text=_missing(store, store.inputs.detections)
        )
    return None if seen is None else seen[0]


def nearest(store: StoreState, found: Detections, expected: Spot) -> tuple[Spot, float] | None:
    """Return the detection of the item's type nearest to a spot, and the height of its centre [m].

    None: none is near enough.
    """
    _, item = store.now
    _check(found)
    rows = zip(found.types, found.position, found.orientation, strict=True)
    spots = [
        (_in_odometry(store, found.frame, position, yaw_of(orientation)), position[2])
        for item_type, position, orientation in rows
        if item_type == item.type
    ]
    seen = min(spots, key=lambda row: _distance(row[0], expected), default=None)
    if seen is None or _distance(seen[0], expected) > store.settings.tolerances.found:
        return None
    return seen


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
    types = ", ".join(t for t in dict.fromkeys(found.types) if t in store.stock.types) or "nothing"
    return (
        f"missing, no {item.type} within {near:g} mm of where {item.name} should be in "
        f"{store.visit.views} views; seen: {types}"
    )
