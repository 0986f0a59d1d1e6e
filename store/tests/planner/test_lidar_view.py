"""What lidars see that is on no map, and what of it is in the way of a route."""

import math
from pathlib import Path

import numpy as np
import pytest
from support.services.floor import box, scan_of

from stepbus_schemas import BaseState, Description, PlanRequest
from stepbus_store.planner.base_path import BasePlanner
from stepbus_store.planner.lidar_view import SEEN, LidarView, RouteMonitor
from stepbus_store.planner.obstacles import Obstacles
from stepbus_store.planner.params import Params
from stepbus_store.planner.walkers import Walkers

MOUNT = (0.31, 0.0, 0.0)
PARAMS = Params(model=Path(), joints=(), base_speed=0.6, base_acceleration=1.25)
HERE = BaseState(x=0.0, y=0.0, yaw=0.0, vx=0.0, wz=0.0)


def seen(*boxes, base=HERE, mapped=(), noise=0.0):
    """Return what is seen of boxes, each x and y of its middle [m], 0.3 m wide."""
    view = LidarView({"front": MOUNT})
    view.take("front", scan_of(boxes, base, MOUNT, noise=noise), base)
    return view.things(mapped)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_a_box_is_seen_where_it_is_from_anywhere(yaw):
    base = BaseState(x=1.0, y=-0.5, yaw=yaw, vx=0.0, wz=0.0)
    ahead = (1.0 + 1.5 * math.cos(yaw), -0.5 + 1.5 * math.sin(yaw))
    (thing,) = seen(ahead, base=base, noise=0.01)
    assert thing.link == SEEN
    assert np.linalg.norm(thing.corners.mean(axis=0) - ahead) < 0.15
    assert np.abs(thing.corners - ahead).max() < 0.4


def test_what_is_on_the_map_is_not_new():
    assert seen((1.5, 0.0), mapped=[box(1.5, 0.0)]) == []
    (thing,) = seen((1.5, 0.0), (1.5, 1.0), mapped=[box(1.5, 0.0)])
    assert thing.corners[:, 1].min() > 0.7


def monitor(known=()):
    route = [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (2.0, 0.0, 0.0)]
    return RouteMonitor(7, route, list(known), PARAMS)


def walk(watch, places, base=lambda _: HERE):
    """Return what is said of a box that is at these places, every 48 ms."""
    seen = Walkers()
    for number, place in enumerate(places):
        seen.look([box(*place)], 0.048 * number)
        text = watch.check(seen, base(number))
        if text:
            return number, text
    return None


def drives(number, x=0.0):
    """Return a base that drives along the route at 0.6 m/s."""
    return BaseState(x=x + 0.6 * 0.048 * number, y=0.0, yaw=0.0, vx=0.6, wz=0.0)


def test_what_is_new_beside_the_route_is_told_with_its_distance():
    number, text = walk(monitor(), [(1.2, 0.4)])
    assert number == 0
    assert text == f"{SEEN} is 0.25 m from the route, 1.1 m ahead"


def test_what_was_there_when_it_was_planned_is_no_surprise():
    assert walk(monitor([box(1.2, 0.55)]), [(1.2, 0.55)] * 20) is None


def test_what_is_behind_or_beside_the_base_hinders_nothing():
    assert walk(monitor(), [(-0.8, 0.0)] * 20) is None
    assert walk(monitor(), [(0.0, 0.5)] * 20) is None


@pytest.mark.parametrize("speed", [0.4, 1.0, 1.6])
def test_it_stops_for_who_crosses_its_way_before_that_is_too_late(speed):
    # Both would be at 1.3 m after 2.2 s.
    places = [(1.3, 2.2 * speed - speed * 0.048 * n) for n in range(46)]
    number, text = walk(monitor(), places, drives)
    assert text == f"{SEEN} walks towards its way"
    # It comes to rest within 0.07 m.
    assert drives(number).x + 0.07 + PARAMS.base_radius < 1.3 - 0.15


@pytest.mark.parametrize("speed", [0.4, 1.0, 1.6])
def test_it_does_not_stop_for_who_follows_it(speed):
    places = [(-0.9 + min(speed, 0.7) * 0.048 * n, 0.1) for n in range(30)]
    assert walk(monitor(), places, drives) is None


def test_what_the_base_has_passed_hinders_it_no_more():
    watch, seen = monitor(), Walkers()
    for number in range(60):
        assert watch.check(seen, drives(number)) == ""
    seen.look([box(0.3, 0.3)], 3.0)
    assert watch.check(seen, drives(60)) == ""


@pytest.mark.parametrize(("there", "aside", "needless"), [(1, 1.2, 0), (0, 1.2, 1), (0, 0.0, 0)])
def test_a_detour_around_what_has_gone_is_needless(there, aside, needless):
    route = [(0.0, 0.0, 0.0), (0.0, aside, 0.0), (2.0, aside, 0.0), (2.0, 0.0, 0.0)]
    watch, view = RouteMonitor(7, route, [box(1.2, 0.0)], PARAMS), LidarView({"front": MOUNT})
    view.take("front", scan_of([(1.2, 0.0)] * there, HERE, MOUNT), HERE)
    looks = [watch.is_needless(view) for _ in range(8)]
    # It has to be seen for 0.3 s.
    assert looks == [False] * 5 + [bool(needless)] * 3


def plan(*boxes, goal=(2.0, 0.0, 0.0), before=None, held=""):
    """Return an answer; boxes: where each is; before: 0.3 s ago. It may give way."""
    seen = Walkers()
    for t, places in ((0.0, before or boxes), (0.3, boxes)):
        seen.look([box(*at) for at in places], t)
    return plan_among(seen, goal, held)


def plan_among(seen, goal=(2.0, 0.0, 0.0), held=""):
    """Return an answer among what is seen; the base may give way."""
    described = Description(names=["chassis"], details={"shape": [""], "body": ["robot"]})
    planner = BasePlanner(Obstacles("poses", described, "chassis"), PARAMS)
    request = PlanRequest(id=7, start=[], goal=[], held=held, base=((0.0, 0.0, 0.0), goal))
    return planner.plan(request, [], seen, may_give_way=True)


def test_a_route_leads_around_what_is_seen():
    answer = plan((1.0, 0.0))
    assert answer.cause == ""
    gaps = [np.abs(np.array(pose[:2]) - (1.0, 0.0)).max() for pose in answer.route]
    assert min(gaps) > 0.3


def test_a_place_where_something_stands_is_given_up_at_once():
    answer = plan((2.1, 0.0))
    assert answer.cause == "goal_in_collision"
    assert answer.text.startswith(f"{SEEN} is 0.")


def test_a_goal_where_what_is_held_has_no_room_is_given_up():
    there, goal = (0.85, 0.0), (0.2, 0.0, 0.0)
    assert plan(there, goal=goal).cause == ""
    answer = plan(there, goal=goal, held="can")
    assert answer.cause == "goal_in_collision"
    assert answer.text == f"{SEEN} is less than 0.1 m from what the hand holds at the goal"


def test_it_waits_for_who_walks_there_or_has_just_stopped():
    assert plan((1.0, 0.6), before=[(1.0, 0.9)]).cause == "occupied"
    seen = Walkers()
    for t, y in ((0.0, 0.6), (0.3, 0.3), (0.6, 0.0), (1.0, 0.0), (1.4, 0.0)):
        seen.look([box(1.0, y)], t)
    assert (len(seen.pausing), seen.walking, seen.standing) == (1, [], [])
    # A way around him takes longer than he is expected to stand.
    assert plan_among(seen).cause == "occupied"
    seen.look([box(1.0, 0.0)], 4.0)
    assert (seen.pausing, seen.walking, len(seen.standing)) == ([], [], 1)
    assert plan_among(seen).text.startswith("base: detour")


def test_it_gives_way_to_who_walks_towards_where_it_stands():
    answer = plan((2.4, 0.0), goal=(4.0, 0.0, 0.0), before=[(2.7, 0.0)])
    assert answer.text.startswith("gives way 0.9 m, then base: ")
    assert answer.route[0] == (-0.9, 0.0, 0.0)
    # To whoever comes from behind, it gives way by driving on.
    assert plan((-1.3, 0.0), before=[(-1.6, 0.0)]).route[-1][0] == 2.0


def test_a_snapshot_does_not_change_with_later_scans():
    view = LidarView({"front": MOUNT, "back": (-0.31, 0.0, math.pi)})
    view.take("front", scan_of([(1.5, 0.0)], HERE, MOUNT), HERE)
    before = view.snapshot()
    view.take("front", scan_of([], HERE, MOUNT), HERE)
    view.take("back", scan_of([(-1.5, 0.0)], HERE, (-0.31, 0.0, math.pi)), HERE)
    (thing,) = before.things([])
    assert thing.corners[:, 0].min() > 1.0
