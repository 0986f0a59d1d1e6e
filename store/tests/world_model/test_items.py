"""Where the items are, as far as anybody has told or seen."""

import numpy as np
import pinocchio as pin
import pytest

from stepbus_store.world_model.world_model import ItemPose, Items

TYPES = {"cola_1": "cola", "cola_2": "cola", "soup_1": "soup"}


def at(x, y=0.0, z=0.2, yaw=0.0):
    return ItemPose(x=x, y=y, z=z, yaw=yaw)


@pytest.fixture
def items():
    places = {"cola_1": at(0.0), "cola_2": at(0.12), "soup_1": at(0.24)}
    return Items(TYPES, places, same=0.05)


def tip(x, y, z, yaw=0.0):
    return pin.SE3(pin.utils.rotate("z", yaw), np.array([x, y, z]))


def test_what_is_seen_is_the_nearest_one_of_its_type(items):
    items.see("cola", 0.115, 0.008, 0.1)
    assert items.places["cola_2"] == at(0.115, 0.008, yaw=0.1)
    assert items.places["cola_1"] == at(0.0)


def test_what_is_seen_far_from_all_is_none_of_them(items):
    items.see("soup", 0.12, 0.0, 0.0)
    assert items.places["soup_1"] == at(0.24)


def test_the_gripper_holds_what_is_nearest_to_its_tip_and_carries_it_along(items):
    items.carry(tip(0.125, 0.0, 0.28), holding=True)
    assert items.held == "cola_2"
    items.carry(tip(1.0, 1.0, 0.58, yaw=np.pi / 2), holding=True)
    place = items.places["cola_2"]
    assert (place.x, place.y, place.z, place.yaw) == pytest.approx((1.0, 0.995, 0.5, np.pi / 2))


def test_what_is_let_go_of_stays(items):
    items.carry(tip(0.12, 0.0, 0.28), holding=True)
    items.carry(tip(1.0, 0.0, 0.28), holding=False)
    items.carry(tip(2.0, 0.0, 0.28), holding=False)
    assert items.held == ""
    assert items.places["cola_2"].x == pytest.approx(1.0)


def test_what_is_held_is_not_seen_elsewhere(items):
    items.carry(tip(0.12, 0.0, 0.28), holding=True)
    items.see("cola", 0.13, 0.0, 0.0)
    items.carry(tip(0.12, 0.0, 0.28), holding=True)
    assert items.places["cola_2"].x == pytest.approx(0.12)


def test_a_gripper_that_closes_on_nothing_known_holds_nothing_known(items):
    items.carry(tip(0.5, 0.5, 0.28), holding=True)
    assert items.held == ""
