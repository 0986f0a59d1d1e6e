"""Routes of a base on the floor, around obstacles that are written down here."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from stepbus_schemas import Description, PlanRequest, Poses
from stepbus_store.motion.base_segments import arc_direction
from stepbus_store.planner.base_path import BasePlanner
from stepbus_store.planner.obstacles import Obstacles
from stepbus_store.planner.params import Params

RADIUS = 0.4
HALF_WIDTH = 0.37
PARAMS = Params(model=Path(), joints=(), base_radius=RADIUS, base_half_width=HALF_WIDTH)
BOX = "box 0.3 0.3 0.4"


def plan(start, goal, *crates, at=None):
    """Return the plan around crates of 0.3 m; at: true pose x, y of the base, else its odometry."""
    names = ["chassis", *(f"crate_{n}" for n in range(len(crates)))]
    described = Description(
        names=names, details={"shape": ["", *[BOX] * len(crates)], "body": names}
    )
    x, y = at or start[:2]
    yaw = start[2]
    poses = Poses(
        position=[(x, y, 0.0), *((cx, cy, 0.2) for cx, cy in crates)],
        orientation=[
            (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
            *[(0.0, 0.0, 0.0, 1.0)] * len(crates),
        ],
    )
    planner = BasePlanner(Obstacles("poses", described, "chassis"), PARAMS)
    request = PlanRequest(id=7, start=[], goal=[], base=(start, goal))
    return planner.plan(request, planner.mapped(request, poses))


def closest(start, route, crate):
    """Return the least distance of a route to the outline of a crate [m]."""
    points = [start[:2], *(point[:2] for point in route)]
    dense = [
        np.array(a) + s * (np.array(b) - np.array(a))
        for a, b in pairwise(points)
        for s in np.linspace(0, 1, 200)
    ]
    return min(np.linalg.norm(np.maximum(np.abs(p - crate) - 0.15, 0.0)) for p in dense)


def arcs(start, route):
    """Return for each segment whether it is an arc: forwards 1, backwards -1, neither 0."""
    return [arc_direction(a, b) for a, b in pairwise([start, *route])]


@pytest.mark.parametrize(
    ("start", "goal", "direction"),
    [
        ((0.0, 0.0, 0.0), (1.5, 0.4, 0.0), 1),
        ((0.0, 0.0, 0.2), (1.5, 0.2, -0.1), 1),
        ((1.5, 0.4, 0.0), (0.0, 0.0, 0.0), -1),
    ],
)
def test_the_base_drives_one_curve_without_a_stop_where_nothing_is_in_the_way(
    start, goal, direction
):
    found = plan(start, goal, (0.7, 1.5))
    assert set(arcs(start, found.route)) == {direction}
    assert found.route[-1] == goal
    straight = math.dist(start[:2], goal[:2])
    assert float(found.text.split()[2]) == pytest.approx(straight, rel=0.06)


def test_a_curve_that_would_touch_something_is_not_taken():
    start, goal, crate = (0.0, 0.0, 0.0), (2.0, 1.0, 0.0), (1.55, 0.37)
    free = plan(start, goal).route
    around = plan(start, goal, crate).route
    assert closest(start, free, crate) < HALF_WIDTH - 0.01
    assert closest(start, around, crate) >= HALF_WIDTH - 2e-3


def test_a_detour_is_driven_around_its_corners_without_a_stop():
    start = (0.0, 0.0, 0.0)
    route = plan(start, (2.4, 0.0, 0.0), (1.2, 0.0)).route
    assert set(arcs(route[0], route[1:-1])) == {1}


@pytest.mark.parametrize("crate", [(0.8, 0.0), (0.8, 0.2), (0.9, -0.3)])
def test_the_base_drives_around_what_is_in_the_way(crate):
    start = (0.0, 0.0, 0.0)
    found = plan(start, (2.0, 0.0, 0.0), crate)
    assert found.cause == ""
    assert found.route[-1] == (2.0, 0.0, 0.0)
    assert closest(start, found.route, crate) >= HALF_WIDTH - 1e-9


def test_a_base_that_cannot_turn_leaves_straight_first():
    start = (0.0, 0.0, 0.0)
    found = plan(start, (2.0, 0.0, 0.0), (0.46, 0.0))
    x, y, _ = found.route[0]
    assert y == pytest.approx(0.0, abs=1e-9)
    assert -0.15 < x <= 0.46 - 0.15 - RADIUS
    assert closest((x, y), found.route, (0.46, 0.0)) >= HALF_WIDTH - 1e-9


def test_a_goal_that_is_too_close_to_something_is_refused_with_its_name():
    found = plan((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.4, 0.0))
    assert found.cause == "goal_in_collision"
    assert found.text.startswith("crate_0 is 0.25 m from the goal")


def test_a_wall_without_end_leaves_no_path():
    wall = [(1.0, 0.25 * n) for n in range(-8, 9)]
    assert plan((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), *wall).cause == "no_path"


def test_odometry_that_has_drifted_does_not_move_the_obstacles():
    one = plan((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.8, 0.1))
    other = plan((0.5, -0.2, 0.0), (2.5, -0.2, 0.0), (0.8, 0.1), at=(0.0, 0.0))
    assert np.allclose(np.add(one.route, (0.5, -0.2, 0.0)), other.route)
