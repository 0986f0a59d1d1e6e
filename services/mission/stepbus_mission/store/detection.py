"""Finds the item with the camera: from above the shelf, then from near."""

from __future__ import annotations

import math

from stepbus_participant.settings import nearest
from stepbus_schemas import Detections, RunError
from stepbus_schemas.messages import Point

from .geometry import Spot, spot_of, yaw_of
from .goals import ODOMETRY
from .sale import Outcome, Shop


def find(shop: Shop) -> Outcome | None:
    """Find the item near the place where it should be."""
    sale, item = shop.now
    spot = _looked(shop)
    if isinstance(spot, Outcome):
        if spot.word == "missing":
            shop.missing.append(item.name)
            shop.tell(spot.why, "warning")
        return spot
    if spot is not None:
        expected = shop.expected()
        off = math.hypot(spot.x - expected.x, spot.y - expected.y)
        shop.tell(f"found {item.name}, {off * 1e3:.1f} mm from where it was expected")
        sale.place, sale.corrections = spot, 0
        sale.attempts += 1
        return Outcome(word="found")
    return None


def correct(shop: Shop) -> Outcome | None:
    """Look again from near, and go on once the item is where the hand is."""
    sale, item = shop.now
    spot = _looked(shop)
    if spot is None or isinstance(spot, Outcome):
        return spot
    before = shop.expected()
    off = math.hypot(spot.x - before.x, spot.y - before.y)
    truth = shop.stock.pose(item.name, shop.seen.poses)[0]
    sale.found_off = math.hypot(spot.x - truth[0], spot.y - truth[1])
    sale.place = spot
    if off < shop.settings.tolerances.steady:
        return Outcome(word="steady")
    if sale.corrections == shop.settings.corrections:
        text = f"still seen {off * 1e3:.1f} mm away after {sale.corrections} corrections"
        shop.tell(text, "warning")
        return Outcome(word="steady")
    sale.corrections += 1
    return Outcome(word="moved")


def _looked(shop: Shop) -> Spot | Outcome | None:
    """Return where the item was seen, with the heading along which the hand opens.

    An outcome: it is missing, or there was no picture; None: wait for the next one.
    """
    visit, waits = shop.visit, shop.settings.waits
    if shop.lasts < waits.still:
        return None
    if shop.seen.detections is None:
        if shop.lasts < waits.camera or visit.looks:
            return None
        why = f"the camera shows nothing: no detections for {waits.camera:g} s above the shelf"
        return Outcome(word="blind", cause="blind", why=why)
    visit.looks += 1
    spot = _nearest(shop, shop.seen.detections)
    if spot is None and visit.looks == shop.settings.looks:
        return Outcome(word="missing", cause="missing", why=_missing(shop, shop.seen.detections))
    return spot


def _nearest(shop: Shop, found: Detections) -> Spot | None:
    """Return the nearest item of the kind, where it is near enough."""
    _, item = shop.now
    expected = shop.expected()
    _check(found)
    rows = zip(found.types, found.position, found.orientation, strict=True)
    spots = [
        _in_odometry(shop, found.frame, position, yaw_of(turn))
        for kind, position, turn in rows
        if kind == item.kind
    ]
    spot = min(spots, key=lambda spot: _gap(spot, expected), default=None)
    if spot is None or _gap(spot, expected) > shop.settings.tolerances.found:
        return None
    return Spot(x=spot.x, y=spot.y, yaw=shop.opening_yaw(spot.yaw))


def _check(found: Detections) -> None:
    """Raise RunError for detections that are none."""
    counts = (len(found.types), len(found.position), len(found.orientation))
    if len(set(counts)) > 1:
        kinds, places, turns = counts
        raise RunError(f"detections have {kinds} kinds, {places} positions, {turns} orientations")
    for kind, position, turn in zip(found.types, found.position, found.orientation, strict=True):
        if not math.isfinite(sum(position) + sum(turn)):
            raise RunError(f"{kind} was detected at {position}, turned by {turn}: that is no pose")


def _gap(a: Spot, b: Spot) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def _in_odometry(shop: Shop, frame: str, position: Point, yaw: float) -> Spot:
    """Return a detection in the frame of odometry; raises RunError for a frame nobody knows."""
    if frame in {ODOMETRY, "world"}:
        return Spot(x=position[0], y=position[1], yaw=yaw)
    if frame != shop.settings.base_frame:
        known = [shop.settings.base_frame, ODOMETRY]
        raise RunError(f"detections are given in {frame!r}; {nearest(frame, known)}")
    base = spot_of(shop.seen.odometry)
    there = base.ahead(position[0], left=position[1])
    return Spot(x=there.x, y=there.y, yaw=base.yaw + yaw)


def _missing(shop: Shop, found: Detections) -> str:
    _, item = shop.now
    near = shop.settings.tolerances.found * 1e3
    kinds = ", ".join(dict.fromkeys(found.types)) or "nothing"
    return (
        f"missing, no {item.kind} within {near:g} mm of the place of {item.name} in "
        f"{shop.visit.looks} looks; seen: {kinds}"
    )
