"""When the mission asks for images, and what it makes of one without its item."""

import math

import pytest
from support.services.mission_sale import sell
from support.services.mission_store import FakeStore, shelf_a

GOODS = (("cola", 2), ("cola", 3), ("water", 4), ("juice", 5))


def test_an_item_that_lies_is_told_from_a_missing_one_and_the_next_is_taken():
    store = FakeStore(shelf_a(*GOODS))
    store.things["cola_a1_2"].tilt = math.pi / 2
    result = sell(store, verification="camera")
    assert "lying, cola_a1_2 lies 0 mm from where" in result.text
    assert "cola_a1_3" in result.summary


def test_what_hides_an_item_is_told_from_an_empty_shelf():
    result = sell(FakeStore(shelf_a(*GOODS), hidden=("cola_a1_2",), covered=0.8))
    assert "hidden, something hides 80%" in result.text
    assert "cola_a1_3" in result.summary


def test_images_are_asked_for_where_they_are_needed_and_nowhere_else():
    result = sell(FakeStore(shelf_a(*GOODS), requested=True), verification="camera")
    assert result.end
    assert [state for state, _ in result.requests] == ["find", "correct", "verify"]
    assert [request.id for _, request in result.requests] == [0, 1, 2]


def test_a_request_says_where_the_item_is_expected():
    result = sell(FakeStore(shelf_a(*GOODS), requested=True, drift=(0.1, 0.2, 0.3)))
    (_, first), *_ = result.requests
    assert first.frame == "chassis"
    # It stands 0.45 m before the front line, on which row 1 is 0.065 m farther.
    assert first.position == pytest.approx((0.515, 0.0, 0.2 + 2 * 0.0575), abs=1e-6)


def test_what_is_lost_is_asked_for_again():
    result = sell(FakeStore(shelf_a(*GOODS), requested=True, loses=2))
    assert result.end
    assert [state for state, _ in result.requests][:3] == ["find"] * 3
