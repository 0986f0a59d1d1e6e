"""Sales without the truth: a planogram, odometry that has drifted, verification by the camera."""

import math

import pytest
from support.services.mission_sale import sell
from support.services.mission_store import FakeStore, shelf_a

from stepbus_schemas import BaseState, Detections

DRIFT = (0.03, -0.02, 0.05)
GOODS = (("cola", 2), ("water", 4), ("juice", 5))


def honest(*, drift=DRIFT, orders=("cola",), goods=GOODS, **faults):
    store = FakeStore(shelf_a(*goods), drift=drift, **faults)
    return store, sell(store, verification="camera", orders=list(orders))


def on_the_map(store, name):
    thing, (x, y, yaw) = store.things[name], store.drift
    c, s = math.cos(yaw), math.sin(yaw)
    return x + c * thing.x - s * thing.y, y + s * thing.x + c * thing.y


def test_an_item_comes_to_its_spot_on_the_map_however_odometry_has_drifted():
    store, result = honest()
    assert result.end == "1 of 1 sales are done"
    assert on_the_map(store, "cola_a1_2") == pytest.approx((0.15, 0.65), abs=1e-6)


def test_the_base_stands_before_the_item_on_the_map():
    _, result = honest()
    goal = result.goals[result.goal_states.index("drive")]
    store = FakeStore(shelf_a(*GOODS), drift=DRIFT)
    x, y, yaw = store.in_odometry(1.95 - 0.45, -0.2, 0.0)
    assert goal.base == pytest.approx((x, y, yaw))


def test_what_nobody_knows_is_not_in_the_report():
    _, result = honest()
    assert result.summary.splitlines()[1].split()[:7] == [
        "1",
        "cola_a1_2",
        "1",
        "-",
        "0.0",
        "mm",
        "-",
    ]


def test_the_camera_notices_an_item_that_stands_beside_its_spot():
    _, result = honest(place_shift=0.015)
    assert "misplaced, 15.0 mm from its spot" in result.error


def test_the_camera_notices_an_item_that_lies_too_high():
    store = FakeStore(shelf_a(*GOODS), drift=DRIFT)
    detections = store.detections

    def raised():
        found = detections()
        if store.sent.get("up"):
            found.position[:] = [(x, y, z + 0.02) for x, y, z in found.position]
        return found

    store.detections = raised
    assert "its bottom is 20.0 mm above" in sell(store, verification="camera").error


def test_a_camera_that_fails_above_the_outlet_is_the_reason():
    _, result = honest(dark=("up", 1))
    assert "no detections for 3 s above the outlet" in result.error


LATER = 30
"""Detections after which the arm rests."""


@pytest.mark.parametrize(("state", "where"), [("inspect", "shelf"), ("up", "outlet")])
def test_a_camera_that_fails_after_one_image_is_the_reason_too(state, where):
    store = FakeStore(shelf_a(*GOODS), drift=DRIFT)
    detections, calls = store.detections, []

    def once():
        found = detections()
        if not store.sent.get(state) or found is None:
            return found
        calls.append(found)
        nothing = {"types": [], "position": [], "orientation": [], "confidence": []}
        return Detections(frame=found.frame, **nothing) if len(calls) == LATER else None

    store.detections = once
    result = sell(store, verification="camera", orders=["cola"])
    assert f"no detections for 3 s above the {where}" in result.error


def test_without_a_view_of_the_outlet_the_item_is_put_down_all_the_same_with_a_warning():
    _, result = honest(dark=("above", 1))
    assert "nothing above the outlet for 3 s" in result.text


def test_an_item_dropped_above_the_outlet_is_noticed():
    _, result = honest(drops=(("above", 1),))
    assert "dropped" in result.error


def test_several_sales_in_a_row():
    store, result = honest(orders=("cola", "water", "juice"))
    assert result.end == "3 of 3 sales are done"
    xs = [on_the_map(store, name)[0] for name in ("cola_a1_2", "water_a1_4", "juice_a1_5")]
    assert xs == pytest.approx([0.03, 0.15, 0.27])


def test_the_report_names_who_has_measured():
    assert honest()[1].summary.endswith("placed within 0.0 mm by the camera")
    true = sell(FakeStore(shelf_a(*GOODS)), orders=["cola"])
    assert "0.0 mm by the true poses, other items" in true.summary


def test_without_a_world_model_everything_stops():
    store = FakeStore(shelf_a(*GOODS), drift=DRIFT)
    pose = store.pose
    nowhere = BaseState(x=math.inf, y=math.inf, yaw=0.0, vx=0.0, wz=0.0)
    store.pose = lambda: nowhere if store.sent.get("inspect") else pose()
    result = sell(store, verification="camera")
    assert "pose is unknown; everything is at rest" in result.error
