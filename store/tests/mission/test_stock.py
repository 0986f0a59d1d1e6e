"""The stock: measures out of the plant's description, shelves out of names, moves out of poses."""

import math

import pytest

from stepbus_schemas import Contacts, Description, Poses, WiringError
from stepbus_store.mission.inventory import Stock, measures
from stepbus_store.mission.witness import Witness

HALF = math.sqrt(0.5)
CAN = "cylinder 0.033 0.115 @ 0 0 0.0575 0 0 0 1"
BOTTLE = "cylinder 0.032 0.1 @ 0 0 0.05 0 0 0 1; cylinder 0.015 0.05 @ 0 0 0.125 0 0 0 1"


def stock(*names):
    kinds = [name.partition("_")[0] if "_" in name else "" for name in names]
    shapes = [CAN if kind else "" for kind in kinds]
    details = {"type": kinds, "shape": shapes}
    return Stock(Description(names=list(names), details=details), ["a", "b"])


def poses(*points):
    return Poses(position=list(points), orientation=[(0.0, 0.0, 0.0, 1.0)] * len(points))


def test_a_bottle_has_a_body_and_a_neck():
    bottle = measures("water", BOTTLE)
    assert bottle.width == pytest.approx((0.064, 0.064))
    assert (bottle.bottom, bottle.body_top, bottle.top) == pytest.approx((0.0, 0.1, 0.15))


def test_a_shape_that_is_turned_in_its_link_is_measured_as_it_stands():
    lying = measures("juice", f"box 0.12 0.06 0.05 @ 0 0 0 0 {HALF} 0 {HALF}")
    assert lying.width == pytest.approx((0.05, 0.06))
    assert lying.top - lying.bottom == pytest.approx(0.12)


def test_items_know_their_shelf_by_their_name():
    goods = stock("cola_a1_3", "floor", "cola_b2_1")
    goods.take_inventory(poses((0, 0, 0.2), (0, 0, 0), (1, 0, 0.2)))
    assert [(item.name, item.shelf) for item in goods.items.values()] == [
        ("cola_a1_3", "a"),
        ("cola_b2_1", "b"),
    ]


TOUCH = Contacts(pairs=[("cola_a1_1", "pad")], force=[3.0], distance=[0.0], position=[(0, 0, 0)])


def watched(*points):
    goods = stock(*(f"cola_a1_{number}" for number, _ in enumerate(points, 1)))
    return Witness(goods, poses(*points), 0.002)


def test_what_the_robot_has_touched_it_has_moved():
    witness, now = watched((0, 0, 0)), poses((0.003, 0, 0))
    witness.feel(TOUCH, ["pad"], 0.0)
    assert witness.watch(now, 0.1, "") == []
    assert witness.largest(now, "")[1] == "cola_a1_1"


def test_what_the_robot_knocks_over_knocks_over_the_next_one():
    witness = watched((0, 0, 0), (0.12, 0, 0))
    witness.feel(TOUCH, ["pad"], 0.0)
    witness.watch(poses((0.01, 0, 0), (0.12, 0, 0)), 0.1, "")
    now = poses((0.04, 0, 0), (0.15, 0, 0))
    assert witness.watch(now, 0.2, "") == []
    assert witness.largest(now, "cola_a1_1") == (pytest.approx(0.03), "cola_a1_2")


def test_what_the_robot_touched_long_ago_others_may_have_moved():
    witness = watched((0, 0, 0))
    witness.feel(TOUCH, ["pad"], 0.0)
    ((moved, _),) = witness.watch(poses((0.003, 0, 0)), 5.0, "")
    assert moved == "cola_a1_1"


def test_a_post_beside_the_gripper_pushes_what_the_robot_does_not_touch():
    witness = watched((0, 0, 0), (0.1, 0, 0))
    # Between the pads, 34 mm from its neighbour.
    held = [poses((0, 0, z), (0.1, y, 0)) for z, y in ((0.01, 0.0), (0.02, 0.01))]
    assert witness.watch(held[0], 0.05, "cola_a1_1") == []
    ((moved, _),) = witness.watch(held[1], 0.1, "cola_a1_1")
    assert moved == "cola_a1_2"
    assert witness.largest(held[1], "cola_a1_1") == (0.0, "")


def test_what_is_carried_pushes_what_it_comes_near():
    witness = watched((0, 0, 0), (0.1, 0, 0))
    assert witness.watch(poses((0.03, 0, 0), (0.1, 0, 0)), 0.05, "cola_a1_1") == []
    assert witness.watch(poses((0.045, 0, 0), (0.111, 0, 0)), 0.1, "cola_a1_1") == []
    assert witness.largest(poses((0.05, 0, 0), (0.12, 0, 0)), "cola_a1_1")[1] == "cola_a1_2"


def test_what_is_carried_over_an_item_pushes_it_as_little_as_one_behind_it():
    witness = watched((0, 0, 0.3), (0.1, 0, 0))
    witness.watch(poses((0.05, 0, 0.3), (0.1, 0, 0)), 0.05, "cola_a1_1")
    assert len(witness.watch(poses((0.09, 0, 0.3), (0.11, 0, 0)), 0.1, "cola_a1_1")) == 1


def test_an_item_is_pushed_by_one_that_is_pushed_in_whatever_order_they_are_listed():
    witness = watched((0.2, 0, 0), (0.1, 0, 0), (0, 0, 0))
    now = poses((0.22, 0, 0), (0.14, 0, 0), (0.06, 0, 0))
    assert witness.watch(now, 0.1, "cola_a1_3") == []
    assert witness.largest(now, "cola_a1_3") == (pytest.approx(0.04), "cola_a1_2")


def test_what_others_moved_is_reported_once_and_may_be_moved_by_the_robot_later():
    witness = watched((0, 0, 0))
    assert witness.watch(poses((0.5, 0, 0)), 0.1, "") == [("cola_a1_1", 0.5)]
    assert witness.watch(poses((0.501, 0, 0)), 0.2, "") == []
    assert witness.largest(poses((0.501, 0, 0)), "") == (0.0, "")
    witness.watch(poses((0.501, 0, 0)), 0.3, "")
    witness.feel(TOUCH, ["pad"], 0.3)
    pushed = poses((0.504, 0, 0))
    assert witness.watch(pushed, 0.4, "") == []
    assert witness.largest(pushed, "") == (pytest.approx(0.003), "cola_a1_1")


def test_a_description_with_too_few_kinds_is_refused():
    details = {"type": ["cola"], "shape": [CAN]}
    with pytest.raises(WiringError, match="1 types and 1 shapes for 2 links"):
        Stock(Description(names=["cola_a1_1", "chassis"], details=details), ["a"])


@pytest.mark.parametrize("shape", ["mesh", "cylinder 0 0.1", "box nan 1 1", "sphere -1", ""])
def test_an_item_without_a_size_is_refused(shape):
    with pytest.raises(WiringError, match="item 'cola_a1_1'"):
        measures("cola_a1_1", shape)
