"""What lidars see that is on no map, and what of it is in the way of a route."""

import math
from pathlib import Path

import numpy as np
import pytest
from support.services.floor import box, scan_of

from stepbus_schemas import BaseState, Description, PlanRequest, Poses
from stepbus_store.planner.base_path import BasePlanner
from stepbus_store.planner.lidar_view import SEEN, LidarView, RouteMonitor
from stepbus_store.planner.obstacles import Obstacles
from stepbus_store.planner.params import Params

MOUNT = (0.31, 0.0, 0.0)
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
    return RouteMonitor(7, route, [], list(known), 0.36)


def walk(watch, places, base=lambda _: HERE):
    """Return what is said of a box that is at these places, every 48 ms."""
    for number, place in enumerate(places):
        text = watch.check([box(*place)], base(number), 0.048 * number)
        if text:
            return number, text
    return None


def test_what_is_new_beside_the_route_is_told_with_its_distance():
    number, text = walk(monitor(), [(1.2, 0.4)])
    assert number == 0
    assert text == f"{SEEN} is 0.25 m from the route, 1.1 m ahead"


def test_what_was_there_when_it_was_planned_is_no_surprise():
    assert walk(monitor([box(1.2, 0.55)]), [(1.2, 0.55)] * 20) is None


def test_what_is_behind_or_beside_the_base_hinders_nothing():
    assert walk(monitor(), [(-0.8, 0.0)] * 20) is None
    assert walk(monitor(), [(0.0, 0.5)] * 20) is None


def test_a_person_who_walks_towards_the_route_is_told_long_before():
    places = [(1.2, 3.0 - 0.6 * 0.048 * n) for n in range(100)]
    number, text = walk(monitor(), places)
    # 1.5 s ahead of where the room of what stands would begin.
    assert places[number][1] > 0.36 + 0.25 + 0.15 + 0.6
    assert text.startswith(SEEN)


def test_what_the_base_has_passed_hinders_it_no_more():
    def moves(number):
        return BaseState(x=0.6 * 0.048 * number, y=0.0, yaw=0.0, vx=0.6, wz=0.0)

    watch = monitor()
    for number in range(60):
        assert watch.check([], moves(number), 0.048 * number) == ""
    assert watch.check([box(0.3, 0.3)], moves(60), 0.048 * 60) == ""


def plan(*boxes, goal=(2.0, 0.0, 0.0)):
    described = Description(names=["chassis"], details={"shape": [""], "body": ["robot"]})
    planner = BasePlanner(Obstacles("poses", described, "chassis"), Params(model=Path(), joints=()))
    request = PlanRequest(id=7, start=[], goal=[], base=((0.0, 0.0, 0.0), goal))
    poses = Poses(position=[(0.0, 0.0, 0.0)], orientation=[(0.0, 0.0, 0.0, 1.0)])
    return planner.plan(request, planner.mapped(request, poses), [box(*at) for at in boxes])


def test_a_route_leads_around_what_is_seen():
    answer = plan((1.0, 0.0))
    assert answer.cause == ""
    gaps = [np.abs(np.array(pose[:2]) - (1.0, 0.0)).max() for pose in answer.route]
    assert min(gaps) > 0.3


def test_where_only_what_is_seen_is_in_the_way_the_place_is_occupied():
    answer = plan((2.1, 0.0))
    assert answer.cause == "occupied"
    assert answer.text.startswith(f"{SEEN} is 0.")


def test_a_snapshot_does_not_change_with_later_scans():
    view = LidarView({"front": MOUNT, "back": (-0.31, 0.0, math.pi)})
    view.take("front", scan_of([(1.5, 0.0)], HERE, MOUNT), HERE)
    before = view.snapshot()
    view.take("front", scan_of([], HERE, MOUNT), HERE)
    view.take("back", scan_of([(-1.5, 0.0)], HERE, (-0.31, 0.0, math.pi)), HERE)
    (thing,) = before.things([])
    assert thing.corners[:, 0].min() > 1.0
