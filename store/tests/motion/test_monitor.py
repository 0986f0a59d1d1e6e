"""The collision monitor on contacts that are written down here."""

import math
from pathlib import Path

import pytest

from stepbus_schemas import Contacts
from stepbus_store.motion.mobile import Params
from stepbus_store.motion.monitor import CollisionMonitor

LINKS = frozenset({"chassis", "left_wheel", "elbow", "hand", "left_pad", "right_pad"})
FLOOR = ("floor", "left_wheel", 400.0, 0.0)
PADS_AT_CAN = (("can", "left_pad", 15.0, 0.0), ("can", "right_pad", 15.0, 0.0))


def contacts(*rows):
    """Return a message; rows: two links, force [N], distance [m]."""
    rows = sorted(rows)
    return Contacts(
        pairs=[row[:2] for row in rows],
        force=[row[2] for row in rows],
        distance=[row[3] for row in rows],
        position=[(0.0, 0.0, 0.0)] * len(rows),
    )


class Stand:
    """A robot on the floor, whose contacts reach as far as the parameters say [m]."""

    def __init__(self, *, base_links=frozenset(), **params):
        params = Params(model=Path(), joints=(), **{"contact_range": math.inf, **params})
        ignore = frozenset({"left_wheel"})
        self.monitor = CollisionMonitor(params, links=LINKS, base_links=base_links, ignore=ignore)
        self.look(FLOOR)

    def look(self, *rows, holding=False, dt=1.0, speed=1.0):
        """Return what the monitor finds; speed: of every link of the robot [m/s]."""
        return self.monitor.update(
            contacts(*rows), holding=holding, dt=dt, speed_of=lambda _: (speed, speed)
        )

    def take_can(self, *others):
        """Close the pads around a can; others: more contacts."""
        self.monitor.start(["can"], grips=True)
        self.look(FLOOR, *PADS_AT_CAN, *others, holding=True)
        self.monitor.start()


def test_a_robot_that_stands_on_its_wheels_touches_nothing():
    watch = Stand().look(FLOOR)
    assert (watch.collision, watch.near, watch.scale) == (None, None, 1.0)


@pytest.mark.parametrize(
    ("touch", "collision"),
    [
        (("elbow", "pillar", 12.34, 0.0), "elbow touches pillar with 12.3 N"),
        (("elbow", "pillar", 0.4, 0.0), "None"),
        (("left_wheel", "pillar", 9.0, 0.0), "left_wheel touches pillar with 9.0 N"),
        (("elbow", "floor", 9.0, 0.0), "elbow touches floor with 9.0 N"),
        (("chassis", "elbow", 5.0, 0.0), "chassis touches elbow with 5.0 N"),
    ],
)
def test_what_touches_harder_than_half_a_newton_is_named_with_the_force(touch, collision):
    assert str(Stand().look(FLOOR, touch).collision) == collision


def test_only_pads_may_touch_what_the_goal_allows():
    stand = Stand()
    stand.monitor.start(["can"])
    assert stand.look(("can", "left_pad", 5.0, 0.0)).collision is None
    assert stand.look(("can", "hand", 5.0, 0.0)).collision.ours == "hand"
    assert stand.look(("bottle", "left_pad", 5.0, 0.0)).collision.other == "bottle"


def test_a_pad_that_does_not_grip_may_not_press_on_what_it_may_touch():
    stand = Stand()
    stand.monitor.start(["can"])
    watch = stand.look(("can", "left_pad", 5.1, 0.0))
    assert str(watch.collision) == "left_pad touches can with 5.1 N"


@pytest.mark.parametrize(("force", "counts"), [(29.0, False), (31.0, True)])
def test_a_pad_that_grips_may_not_press_harder_than_a_grip_takes(force, counts):
    stand = Stand()
    stand.take_can()
    pads = (("can", "left_pad", force, 0.0), ("can", "right_pad", 15.0, 0.0))
    assert (stand.look(FLOOR, *pads, holding=True).collision is not None) == counts
    stand.monitor.start(["can"], grips=True)
    assert (stand.look(FLOOR, ("can", "left_pad", force, 0.0)).collision is not None) == counts


def test_pads_that_grip_may_touch_anything():
    stand = Stand()
    stand.monitor.start(grips=True)
    assert (
        stand.look(("bottle", "left_pad", 5.0, 0.0), ("left_pad", "right_pad", 9.0, 0.0)).collision
        is None
    )


def test_what_both_pads_hold_is_found_and_may_be_held_on():
    stand = Stand()
    stand.take_can()
    watch = stand.look(*PADS_AT_CAN, holding=True)
    assert (stand.monitor.held, watch.collision) == ("can", None)


def test_what_is_held_may_touch_what_it_stood_on_and_nothing_else():
    stand = Stand()
    stand.take_can(("can", "shelf", 3.0, 0.0))
    assert stand.look(*PADS_AT_CAN, ("can", "shelf", 3.0, 0.0), holding=True).collision is None
    watch = stand.look(*PADS_AT_CAN, ("bottle", "can", 3.0, 0.0), holding=True)
    assert str(watch.collision) == "can touches bottle with 3.0 N"


def test_the_hand_around_what_is_held_does_not_slow_down_but_another_link_near_it_does():
    stand = Stand()
    palm = ("can", "hand", 0.0, 0.013)
    stand.take_can(palm)
    assert stand.look(*PADS_AT_CAN, palm, holding=True).scale == 1.0
    watch = stand.look(*PADS_AT_CAN, palm, ("can", "chassis", 0.0, 0.04), holding=True)
    assert (watch.scale < 0.2, watch.near) == (True, ("can", "chassis"))


def test_what_is_held_must_not_be_pressed_on_the_robot_itself():
    stand = Stand()
    stand.take_can()
    watch = stand.look(*PADS_AT_CAN, ("can", "chassis", 9.0, 0.0), holding=True)
    assert str(watch.collision) == "can touches chassis with 9.0 N"


def test_what_is_held_may_be_put_where_the_goal_allows_it():
    stand = Stand()
    stand.take_can()
    stand.monitor.start(["table"])
    assert stand.look(*PADS_AT_CAN, ("can", "table", 3.0, 0.0), holding=True).collision is None


def test_what_the_pads_let_go_may_be_touched_until_they_are_away():
    stand = Stand()
    stand.take_can()
    stand.look(("can", "left_pad", 2.0, 0.0))
    assert stand.monitor.held == ""
    assert stand.look(("can", "left_pad", 2.0, 0.0)).collision is None
    stand.look(("can", "left_pad", 0.0, 0.03))
    assert stand.look(("can", "left_pad", 2.0, 0.0)).collision is not None


def test_a_touch_from_before_the_goal_counts_only_when_it_becomes_harder():
    stand = Stand()
    stand.look(("elbow", "pillar", 10.0, 0.0))
    stand.monitor.start()
    assert stand.look(("elbow", "pillar", 12.0, 0.0)).collision is None
    assert stand.look(("elbow", "pillar", 16.0, 0.0)).collision is not None


@pytest.mark.parametrize("gap", [0.004, 0.01, 0.03, 0.079])
def test_a_link_is_slow_enough_to_stop_before_what_is_near(gap):
    stand = Stand(arm_brake=1.0)
    stand.monitor.start(moves="arm")
    watch = stand.look(FLOOR, ("elbow", "pillar", 0.0, gap), speed=0.5)
    v = watch.scale * 0.5
    assert v * 0.05 + v**2 / 2.0 == pytest.approx(gap - 0.002)
    assert watch.near == ("elbow", "pillar")


@pytest.mark.parametrize("gap", [-0.01, 0.0, 0.002])
def test_a_link_that_is_all_but_touching_creeps(gap):
    watch = Stand(arm_creep=0.02).look(FLOOR, ("elbow", "pillar", 0.0, gap), speed=0.5)
    assert watch.scale == pytest.approx(0.04)


def test_a_slow_link_is_not_slowed_down_and_nothing_is_near_farther_away():
    assert Stand().look(("elbow", "pillar", 0.0, 0.04), speed=0.1).scale == 1.0
    watch = Stand().look(("elbow", "pillar", 0.0, 0.09), speed=5.0)
    assert (watch.scale, watch.near, watch.room) == (1.0, None, 0.09)


def test_a_link_that_passes_by_counts_with_a_share_of_its_speed():
    towards, past = Stand(), Stand()
    for stand, before in ((towards, 0.03), (past, 0.01)):
        stand.monitor.start(moves="arm")
        stand.look(("elbow", "pillar", 0.0, before), dt=0.1, speed=0.2)
    rows = [
        stand.look(("elbow", "pillar", 0.0, 0.01), dt=0.1, speed=0.2).scale
        for stand in (towards, past)
    ]
    assert rows[0] < rows[1] == 1.0


def test_pads_near_what_they_may_touch_do_not_slow_down():
    stand = Stand()
    stand.monitor.start(["can"])
    assert stand.look(("can", "left_pad", 0.0, 0.01)).scale == 1.0
    assert stand.look(("bottle", "left_pad", 0.0, 0.01)).scale < 1.0


def test_what_is_near_a_base_that_stands_slows_no_arm_down():
    stand = Stand(base_links=frozenset({"chassis", "left_wheel"}))
    near = ("chassis", "pillar", 0.0, 0.02)
    stand.monitor.start(moves="arm")
    assert stand.look(near).scale == 1.0
    assert stand.look(near, ("chassis", "elbow", 0.0, 0.04)).near == ("chassis", "elbow")
    stand.monitor.start()
    assert stand.look(near).scale < 1.0


def test_links_of_the_robot_that_are_near_each_other_do_not_slow_the_base_down():
    stand = Stand()
    stand.monitor.start(moves="base")
    assert stand.look(("chassis", "elbow", 0.0, 0.02)).scale == 1.0
    assert stand.look(("elbow", "pillar", 0.0, 0.04)).scale < 1.0


def test_links_whose_collisions_are_checked_beforehand_slow_nothing_down_but_may_not_touch():
    stand = Stand(srdf=Path("robot.srdf"))
    watch = stand.look(("elbow", "hand", 0.0, 0.003))
    assert (watch.scale, watch.near) == (1.0, None)
    assert stand.look(("elbow", "pillar", 0.0, 0.003)).scale < 1.0
    assert stand.look(("elbow", "hand", 9.0, -0.001)).collision is not None


def test_beside_space_that_nothing_senses_a_link_is_slow_enough_to_stop_within_the_range():
    stand = Stand(contact_range=0.15)
    free, fast, held = (
        stand.look(speed=1.1).scale,
        stand.look(speed=2.0).scale,
        Stand(contact_range=0.15),
    )
    assert (free, fast) == (1.0, pytest.approx(0.59, abs=0.01))
    speed = 2.0 * fast
    assert speed * 0.05 + speed**2 / 16 + 2e-3 == pytest.approx(0.15)
    held.take_can()
    assert held.look(*PADS_AT_CAN, holding=True, speed=2.0).scale < fast
    stand.monitor.start(moves="base")
    assert stand.look(speed=2.0).scale == 1.0


def test_what_comes_fast_is_stopped_for_sooner_than_what_is_near():
    stand = Stand()
    stand.look(("elbow", "pillar", 0.0, 0.10), ("elbow", "crate", 0.0, 0.03), dt=0.016)
    (near, left), _ = stand.look(
        ("elbow", "pillar", 0.0, 0.08), ("elbow", "crate", 0.0, 0.03), dt=0.016
    ).unexpected
    assert near.pair == ("elbow", "pillar")
    assert left == pytest.approx(0.08 - 1.25 * 0.05 - 1.25**2 / 16)


@pytest.mark.parametrize(("gap", "counts"), [(0.1, True), (0.14, False)])
def test_what_appears_all_of_a_sudden_comes_as_fast_as_the_link_moves(gap, counts):
    stand = Stand(contact_range=0.15)
    stand.look(dt=0.016)
    ((_, left),) = stand.look(("elbow", "pillar", 0.0, gap), dt=0.016, speed=0.8).unexpected
    assert left == pytest.approx(gap - counts * (0.8 * 0.05 + 0.8**2 / 16))


def test_where_base_and_arm_move_each_of_them_may_use_up_half_of_a_gap():
    one, both = Stand(), Stand()
    one.monitor.start(moves="arm")
    both.monitor.start(moves="all")
    wide = one.look(("elbow", "pillar", 0.0, 0.03), speed=0.5).scale
    assert both.look(("elbow", "pillar", 0.0, 0.06), speed=0.5).scale == pytest.approx(wide)


def test_what_the_base_passes_is_farther_than_what_it_drives_towards():
    towards, past = Stand(), Stand()
    gaps = []
    for stand, before in ((towards, 0.11), (past, 0.1)):
        stand.monitor.start(moves="base")
        stand.look(("chassis", "pillar", 0.0, before), dt=0.1, speed=0.0)
        row = contacts(("chassis", "pillar", 0.0, 0.1))
        still = {"speed_of": lambda _: (0.0, 0.0), "base_speed": 0.1}
        gaps.append(stand.monitor.update(row, holding=False, dt=0.1, **still).room)
    assert gaps == pytest.approx([0.1, 0.1 / 0.3])
