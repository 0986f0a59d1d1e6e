"""Verifies a sale: where the item stands, and whether others were moved."""

import math

from stepbus_store.mission.geometry import tilt_of
from stepbus_store.mission.goods.witness import Witness
from stepbus_store.mission.report import SaleResult

from .detection import nearest
from .state import Outcome, StoreState


def verify(store: StoreState) -> Outcome | None:
    """Check where the item stands, and that no other item was moved, as far as that is seen."""
    if store.settings.verification == "camera":
        return _verify_by_camera(store)
    if store.elapsed < store.settings.waits.rest:
        return None
    result = _measure(store)
    return _conclude(store, result, _fault(store, result))


def _conclude(store: StoreState, result: SaleResult, fault: str) -> Outcome:
    """End the sale; fault: what is wrong with the placement; empty: nothing."""
    if fault:
        return Outcome(name="misplaced", cause="misplaced", text=fault)
    store.results.append(result)
    store.report(
        f"placed {result.place_error * 1e3:.1f} mm from its spot after {result.duration:.1f} s"
    )
    store.sold.append(result.item)
    store.stock.update(result.item, store.inputs.poses)
    if store.witness is not None:
        store.witness.settle(result.item, store.inputs.poses)
    store.sale = None
    return Outcome(name="good")


def _verify_by_camera(store: StoreState) -> Outcome | None:
    """Check the placement by the camera, which also sees the landmarks of the outlet."""
    visit, waits, settings = store.visit, store.settings.waits, store.settings
    if store.elapsed < waits.still:
        return None
    sale, item = store.now
    found = store.inputs.detections
    if found is None:
        if store.elapsed < waits.camera * (1 + visit.views):
            return None
        text = f"the camera shows nothing: no detections for {waits.camera:g} s above the outlet"
        return Outcome(name="misplaced", cause="blind", text=text)
    visit.views += 1
    spot = store.in_odometry(settings.outlet_spot(sale.number - 1, store.planned))
    seen = nearest(store, found, spot)
    if seen is None:
        if visit.views < settings.views:
            return None
        near = settings.tolerances.found * 1e3
        text = f"no upright {item.type} is seen within {near:g} mm of its spot"
        return Outcome(name="misplaced", cause="misplaced", text=f"misplaced, {text}")
    at, height = seen
    result = SaleResult(
        number=sale.number,
        item=item.name,
        attempts=sale.attempts,
        detection_error=sale.detection_error,
        place_error=math.hypot(at.x - spot.x, at.y - spot.y),
        moved=None,
        duration=store.since(sale.start_ns),
    )
    raised = height - (item.top - item.bottom) / 2 - settings.outlet.position[2]
    return _conclude(store, result, _off(store, result.place_error, raised))


def _off(store: StoreState, away: float, raised: float) -> str:
    """Return that an item is too far from its spot, or above the outlet [m]; empty: it is not."""
    allowed = store.settings.tolerances.placed
    if away > allowed:
        return f"misplaced, {away * 1e3:.1f} mm from its spot"
    if abs(raised) > allowed:
        return f"misplaced, its bottom is {raised * 1e3:.1f} mm above the top of the outlet"
    return ""


def _witness(store: StoreState) -> Witness:
    if store.witness is None:
        raise LookupError("verification by the truth needs a witness")
    return store.witness


def _measure(store: StoreState) -> SaleResult:
    """Return the result of the sale, measured from the true poses."""
    sale, item = store.now
    x, y, _ = store.stock.pose(item.name, store.inputs.poses)[0]
    spot = store.settings.outlet_spot(sale.number - 1, store.planned)
    return SaleResult(
        number=sale.number,
        item=item.name,
        attempts=sale.attempts,
        detection_error=sale.detection_error,
        place_error=math.hypot(x - spot.x, y - spot.y),
        moved=_witness(store).largest(store.inputs.poses, item.name)[0],
        duration=store.since(sale.start_ns),
    )


def _fault(store: StoreState, result: SaleResult) -> str:
    """Return what is wrong with the placement; empty: nothing."""
    allowed = store.settings.tolerances
    _, item = store.now
    position, turn = store.stock.pose(item.name, store.inputs.poses)
    raised = position[2] + item.measures.bottom - store.settings.outlet.position[2]
    if tilt_of(turn) > allowed.tilt and result.place_error <= allowed.placed:
        return f"not upright, tilted by {math.degrees(tilt_of(turn)):.0f}°"
    if fault := _off(store, result.place_error, raised):
        return fault
    moved, other = _witness(store).largest(store.inputs.poses, item.name)
    return f"{other} was moved by {moved * 1e3:.1f} mm" if moved > allowed.moved else ""
