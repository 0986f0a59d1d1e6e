"""Plans routes of a base on the floor: curves around what stands there."""

import heapq
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice, pairwise, product
from typing import Any

import numpy as np
import pinocchio as pin
from msgspec.structs import replace

from stepbus_kinematics import Vector
from stepbus_schemas import Plan, PlanRequest, Point, Poses
from stepbus_store.cause import Cause
from stepbus_store.planner.base_curve import SmoothRoute, direct_routes, rounded_routes
from stepbus_store.planner.obstacles import Obstacles
from stepbus_store.planner.outline import Outline, distances, hull, outermost
from stepbus_store.planner.params import Params
from stepbus_store.planner.walkers import Walkers, going, places_along
from stepbus_store.poses import wrapped

_CELL = 0.05
"""Of the grid that is searched where the straight line is blocked [m]."""

_AROUND = 1.5
"""How far the grid extends beyond start and goal [m]."""

_FLOOR, _TOP = 0.02, 1.3
"""Heights between which a shape is in the way of the robot [m]."""

_LONGEST_ESCAPE, _ESCAPE_STEP = 0.6, 0.02
"""How far, in which steps, the base drives straight to leave a place where it cannot turn [m]."""

_ALONG = 0.01
"""Distance of the places at which a straight line is checked [m]."""

_ROOM = (0.12, 0.06, 0.03, 0.0)
"""By how much farther away than it needs the base looks for a detour [m]."""

_EXITS = 3
"""Places from which a base that holds something looks for a route."""

_FOLDS = 1.0
"""About how long the arm takes to draw in what it holds [s]."""

_NEAR, _APART = 2.0, 0.06
"""About how long it takes to slow down beside something [s] that is not that much farther away than
it has to be [m]."""

_ENOUGH = 3
"""Routes around something after which no more are looked for."""

_AT_CORNER, _WAITS = 4.0, 3.0
"""About how long a leg takes at whose end the base stops and turns; how much time of a detour it
rather waits for somebody who has just stopped to go on [s]."""

_ASIDE = (0.3, -0.3, 0.6, -0.6, 0.9, -0.9)
"""How far the base drives, or drives back, to give way [m]."""

_CARRIED, _HELD, _LEAST, _SWEEP, _HIGH = 0.45, 0.15, 0.1, 0.1, 0.36
"""How far ahead of its axis the base carries something, what room that needs, and at least at both
ends [m], every how much of a turn [rad], beside what is higher than that [m]."""

_STRAIGHT = 1e-6
"""Change of the heading between two poses up to which the base drives straight [rad]."""

_SAME = 1e-3
"""Distance from the goal at which the base only turns [m]."""


class BasePlanner:
    """Plans for a disc around the base's origin, within which it may turn anywhere.

    Curves straight to the goal where one is free; else by A* on a grid (Hart, Nilsson, Raphael
    1968), whose corners are then cut and rounded. extra: by how much more than the parameters want
    the base keeps away [m], as far as it can at both ends, shape (2,) each.
    """

    def __init__(
        self, obstacles: Obstacles, params: Params, extra: float = 0.0, ends: Sequence[Vector] = ()
    ) -> None:
        self._obstacles, self._params = obstacles, params
        self._radius, self._half_width = params.base_radius, params.base_half_width
        self._extra, self._ends = extra, ends

    def _more(self, row: Outline, places: Vector) -> Vector | float:
        """Return by how much more than it has to be the base stays away from something at places.

        At an end it has what room it has there, and half as much more as it is away from that.
        """
        if not self._extra:
            return 0.0
        rooms = (
            max(_distance(end, row) - self._radius, 0.0) + np.linalg.norm(places - end, axis=1) / 2
            for end in self._ends
        )
        return np.asarray(np.minimum(self._extra, np.minimum(*rooms)))

    def mapped(self, request: PlanRequest, poses: Poses) -> list[Outline]:
        """Return the outlines of what the map has, in the frame of the request."""
        skipped = {request.held, *request.touches}
        return self._outlines(self._obstacles.placements(poses), _ends(request)[0], skipped)

    def plan(
        self,
        request: PlanRequest,
        mapped: Sequence[Outline],
        seen: Walkers | None = None,
        *,
        may_give_way: bool = False,
    ) -> Plan:
        """Return the poses of a route in the frame of the request, or why there is none.

        seen: what is on no map. Where there would be a route, or a much faster one, without those
        of it that walk, or have just stopped, the cause is `occupied`; may_give_way: or the route
        leads aside first, where it is not safe to wait.
        """
        seen = Walkers() if seen is None else seen
        posts = [*mapped, *seen.standing]
        plan, seconds = self._plan(request, [*posts, *seen.pausing])
        if seen.pausing and seconds > self._plan(request, posts)[1] + _WAITS:
            plan = Plan(id=plan.id, cause=Cause.OCCUPIED, text=plan.text)
        if not seen.walking or plan.cause not in {"", Cause.OCCUPIED}:
            return plan
        start, _ = _ends(request)
        wait = Plan(id=plan.id, cause=Cause.OCCUPIED, text="somebody walks where the base would go")
        ways = [(self._safety([start], seen), wait)]
        if plan.route:
            ways.insert(0, (self._safety([start, *plan.route], seen), plan))
        if may_give_way and all(safety < 0.0 for safety, _ in ways):
            ways += self._aside(request, [*posts, *seen.pausing], seen)
        return max(ways, key=lambda way: way[0])[1]

    def _safety(self, route: Sequence[Point], seen: Walkers) -> float:
        return seen.safety(going(places_along(route), 0.0, self._params), self._radius)

    def _aside(
        self, request: PlanRequest, outlines: Sequence[Outline], seen: Walkers
    ) -> Iterator[tuple[float, Plan]]:
        """Yield how safe it is to drive straight for a while, and the route from there."""
        start, goal = _ends(request)
        x, y, yaw = start
        places = [(x + far * math.cos(yaw), y + far * math.sin(yaw), yaw) for far in _ASIDE]
        ways = [
            (self._safety([start, place], seen), place)
            for place in places
            if self._is_free(np.array(start[:2]), np.array(place[:2]), outlines)
        ]
        # To plan a way on from each of them takes too long.
        for safety, place in sorted(ways, key=lambda way: -way[0])[:2]:
            plan, _ = self._plan(replace(request, base=(place, goal)), outlines)
            if not plan.cause:
                text = f"gives way {math.dist(start[:2], place[:2]):g} m, then {plan.text}"
                yield safety, replace(plan, text=text, route=[place, *plan.route])

    def _plan(self, request: PlanRequest, outlines: Sequence[Outline]) -> tuple[Plan, float]:
        """Return a plan, and how long its route takes; infinity: there is none [s]."""
        start, goal = _ends(request)
        a, b = np.array(start[:2]), np.array(goal[:2])
        near, gap = _nearest(outlines, b)
        if gap < self._radius:
            text = f"{near} is {gap:.2f} m from the goal; the base needs {self._radius:g} m to turn"
            return Plan(id=request.id, cause=Cause.GOAL_IN_COLLISION, text=text), math.inf
        if request.held and (near := self._in_hand(goal, outlines)):
            text = f"{near} is less than {_LEAST:g} m from what the hand holds at the goal"
            return Plan(id=request.id, cause=Cause.GOAL_IN_COLLISION, text=text), math.inf
        out = self._escape(start, outlines)
        if out is None:
            near, gap = _nearest(outlines, a)
            text = f"{near} is {gap:.2f} m from the base, which cannot leave straight"
            return Plan(id=request.id, cause=Cause.START_IN_COLLISION, text=text), math.inf
        # What is held out needs room where the base turns; with less of it, it drives back first.
        exits = islice(self._exits(out, start[2], outlines), _EXITS) if request.held else ()
        route: SmoothRoute | None = None
        fastest, shape, leaves = math.inf, "", 0.0
        for at, held in [*((at, True) for at in exits), (out, False)]:
            if route is not None and (shape == "direct" or not held):
                break
            pose = (float(at[0]), float(at[1]), start[2])
            way, text = self._smooth(pose, goal, outlines, held=held)
            far = float(np.linalg.norm(at - a))
            if way is None or (seconds := way.seconds + _leaving(far, self._params)) >= fastest:
                continue
            fastest, route, shape, leaves = seconds, way, text, far
        if route is None:
            text = f"no path for the base within {_AROUND:g} m around start and goal"
            return Plan(id=request.id, cause=Cause.NO_PATH, text=text), math.inf
        text = f"base: {shape}, {route.length + leaves:.2f} m, {len(outlines)} obstacles"
        poses = list(route.poses if leaves else route.poses[1:])
        return Plan(id=request.id, text=text, route=poses), fastest

    def _exits(self, at: Vector, yaw: float, outlines: Sequence[Outline]) -> Iterator[Vector]:
        """Yield the point where the base may turn, and points straight behind and before it."""
        yield at
        along = np.array([math.cos(yaw), math.sin(yaw)])
        for far in _ASIDE:
            point: Vector = at + far * along
            if self._is_free(at, point, outlines):
                yield point

    def _smooth(
        self, start: Point, goal: Point, outlines: Sequence[Outline], *, held: bool
    ) -> tuple[SmoothRoute | None, str]:
        """Return a route and its description; held: something is held out, which needs room."""
        if math.dist(start[:2], goal[:2]) < _SAME:
            turn = SmoothRoute(poses=(start, goal), seconds=0.0)
            return (None if held and self._hits(turn, outlines) else turn), "turn"
        for route in direct_routes(start, goal, self._params):
            if self._is_clear(route, outlines, held=held):
                return route, "direct"
        found: list[tuple[float, SmoothRoute, str]] = []
        ends, corners = (np.array(start[:2]), np.array(goal[:2])), None
        apart = BasePlanner(self._obstacles, self._params, _APART, ends)
        for extra in _ROOM:
            if len(found) > _ENOUGH:
                break
            # Corners that keep some distance can be cut.
            wide = BasePlanner(self._obstacles, self._params, extra, ends)
            corners = wide._route(*ends, outlines) or corners
            for route in rounded_routes(start, goal, corners or (), self._params):
                if self._is_clear(route, outlines, held=held):
                    slows = not apart._is_clear(route, outlines, held=False)
                    found.append((route.seconds + _NEAR * slows, route, _detour(corners or ())))
        if found:
            return min(found, key=lambda row: row[0])[1:]
        legs = pairwise(corners or ())
        if corners is None or held or not all(self._is_free(*leg, outlines) for leg in legs):
            return None, ""
        rows = [(float(p[0]), float(p[1]), goal[2]) for p in corners[1:]]
        seconds = _AT_CORNER * len(rows)
        return SmoothRoute(poses=(start, *rows), seconds=seconds), _detour(corners)

    def _is_clear(self, route: SmoothRoute, outlines: Sequence[Outline], *, held: bool) -> bool:
        """Return whether the base may drive along a route; where it turns, its disc counts."""
        poses = np.array(route.poses)
        turns = np.abs(np.diff(poses[:, 2])) > _STRAIGHT
        turning = np.concatenate([turns[:1], turns[1:] | turns[:-1], turns[-1:]])
        needed = np.where(turning, self._radius, self._half_width)
        is_clear = all(
            (distances(poses[:, :2], row.corners) >= needed + self._more(row, poses[:, :2])).all()
            for row in outlines
        )
        return is_clear and not (held and self._hits(route, outlines))

    def _hits(self, route: SmoothRoute, outlines: Sequence[Outline]) -> bool:
        """Return whether what is held out comes too close to something high, but at both ends."""
        rows = [route.poses[0]]
        for (_, _, before), (x, y, yaw) in pairwise(route.poses):
            turn = wrapped(yaw - before)
            count = max(math.ceil(abs(turn) / _SWEEP), 1)
            rows += [(x, y, before + turn * n / count) for n in range(1, count + 1)]
        poses = np.array(rows)
        headings = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
        places = poses[:, :2] + _CARRIED * headings
        gaps = (distances(places, row.corners) for row in outlines if row.top > _HIGH)
        return any((gap < min(_HELD, min(gap[0], gap[-1]) - 1e-3)).any() for gap in gaps)

    def _in_hand(self, pose: Point, outlines: Sequence[Outline]) -> str:
        """Return what is too near to a thing that is held out at a pose; empty: nothing."""
        x, y, yaw = pose
        place = np.array((x + _CARRIED * math.cos(yaw), y + _CARRIED * math.sin(yaw)))
        near, gap = _nearest([row for row in outlines if row.top > _HIGH], place)
        return near if gap < _LEAST else ""

    def _outlines(
        self, placements: Mapping[str, Any], start: Point, skipped: set[str]
    ) -> list[Outline]:
        x, y, yaw = start
        turned = pin.SE3(pin.utils.rotate("z", yaw), np.array([x, y, 0.0]))
        outlines = []
        for name, link in self._obstacles.links.items():
            for solid in () if name in skipped else link.shapes:
                place = turned * placements[name] * solid.placement
                box = solid.geometry.aabb_local
                rows = product(*zip(box.min_, box.max_, strict=True))
                corners = np.array([place.act(np.array(row)) for row in rows])
                if corners[:, 2].max() > _FLOOR and corners[:, 2].min() < _TOP:
                    top = float(corners[:, 2].max())
                    outlines.append(Outline(link=name, corners=hull(corners[:, :2]), top=top))
        return outermost(outlines)

    def _escape(self, start: Point, outlines: Sequence[Outline]) -> Vector | None:
        """Return the nearest point straight ahead or behind at which the base may turn."""
        at, along = np.array(start[:2]), np.array([math.cos(start[2]), math.sin(start[2])])
        if _nearest(outlines, at)[1] >= self._radius:
            return at
        for number in range(1, round(_LONGEST_ESCAPE / _ESCAPE_STEP) + 1):
            for sign in (-1, 1):
                point: Vector = at + sign * number * _ESCAPE_STEP * along
                # On the side of an obstacle, only what leads away from it.
                if _nearest(outlines, point)[1] >= self._radius and not any(
                    _distance(at + sign * 1e-3 * along, row) < _distance(at, row) - 1e-9
                    for row in outlines
                    if _distance(at, row) < self._radius
                ):
                    return point
        return None

    def _route(self, a: Vector, b: Vector, outlines: Sequence[Outline]) -> list[Vector] | None:
        return [a, b] if self._is_free(a, b, outlines) else self._search(a, b, outlines)

    def _is_free(self, a: Vector, b: Vector, outlines: Sequence[Outline]) -> bool:
        count = math.ceil(float(np.linalg.norm(b - a)) / _ALONG)
        line = np.linspace(a, b, count + 1)
        return all(
            (distances(line, row.corners) >= self._half_width + self._more(row, line)).all()
            and _distance(b, row) >= self._radius
            for row in outlines
        )

    def _search(self, a: Vector, b: Vector, outlines: Sequence[Outline]) -> list[Vector] | None:
        """Return the corners of a path on a grid, without those that are not needed."""
        low = np.minimum(a, b) - _AROUND
        size = np.ceil((np.maximum(a, b) + _AROUND - low) / _CELL).astype(int) + 1
        xs, ys = (low[n] + _CELL * np.arange(size[n]) for n in (0, 1))
        cells = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
        turns, drives = np.full(len(cells), True), np.full(len(cells), True)
        for row in outlines:
            gaps = distances(cells, row.corners) - self._more(row, cells)
            turns &= gaps >= self._radius
            drives &= gaps >= self._half_width
        grid, straight = turns.reshape(size), drives.reshape(size)
        first, last = (tuple(np.rint((p - low) / _CELL).astype(int).tolist()) for p in (a, b))
        grid[first] = grid[last] = True
        path = _a_star(grid, first, last)
        if path is None:
            return None
        return [a, *(low + _CELL * np.array(cell) for cell in _cut(path, straight)[1:-1]), b]


def _cut(path: Sequence[tuple[int, int]], free: Any) -> list[tuple[int, int]]:
    """Return cells of a path between which all cells are free, as few as that takes."""

    def sees(one: tuple[int, int], other: tuple[int, int]) -> bool:
        count = 2 * max(abs(one[0] - other[0]), abs(one[1] - other[1]))
        between = np.rint(np.linspace(one, other, count + 1)).astype(int)[1:-1]
        return bool(free[between[:, 0], between[:, 1]].all())

    kept, at = [path[0]], 0
    while at < len(path) - 1:
        at = next((n for n in range(len(path) - 1, at, -1) if sees(path[at], path[n])), at + 1)
        kept.append(path[at])
    return kept


def _ends(request: PlanRequest) -> tuple[Point, Point]:
    if request.base is None:
        raise ValueError("no request of a base")
    return request.base


def _leaving(far: float, params: Params) -> float:
    """Return how much longer the base takes that drives straight before its route [s].

    Meanwhile the arm is drawn in, which has to be done before it turns.
    """
    return max(2.0 * math.sqrt(far / params.base_acceleration) - _FOLDS, 0.0)


def _detour(corners: Sequence[Vector]) -> str:
    bends = len(corners) - 2
    return f"detour with {bends} corner{'s' if bends > 1 else ''}"


def _a_star(grid: Any, first: Any, last: Any) -> list[tuple[int, int]] | None:
    """Return the cells of a shortest path between eight neighbours; ties go to the lower cell."""
    queue: list[tuple[float, tuple[int, int]]] = [(0.0, first)]
    cost = {first: 0.0}
    before: dict[tuple[int, int], tuple[int, int]] = {}
    while queue:
        _, cell = heapq.heappop(queue)
        if cell == last:
            path = [cell]
            while path[-1] != first:
                path.append(before[path[-1]])
            return path[::-1]
        for dx, dy in product((-1, 0, 1), repeat=2):
            x, y = cell[0] + dx, cell[1] + dy
            if not (0 <= x < grid.shape[0] and 0 <= y < grid.shape[1] and grid[x, y]):
                continue
            new = cost[cell] + math.hypot(dx, dy)
            if new < cost.get((x, y), math.inf) - 1e-12:
                cost[x, y], before[x, y] = new, cell
                heapq.heappush(queue, (new + math.dist((x, y), last), (x, y)))
    return None


def _nearest(outlines: Sequence[Outline], point: Vector) -> tuple[str, float]:
    rows = [(_distance(point, row), row.link) for row in outlines]
    gap, link = min(rows, default=(math.inf, ""))
    return link, gap


def _distance(point: Vector, row: Outline) -> float:
    return float(distances(point[None], row.corners)[0])
