"""The path of a base from above: equal axes, a grid, a scale bar, what stands in the world."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from stepbus_orchestrator.analysis.signals import Array
from stepbus_tools.report.units import engineering
from stepbus_tools.viewing.scene.bodies import Messages
from stepbus_tools.viewing.scene.scene import Scene
from stepbus_tools.viewing.viewpoint import moved

from .small import nice_ticks
from .svg import legend

_MOST_POINTS = 1000
_FLOOR_M = 8.0
_WIDTH, _TALLEST, _LOWEST = 860.0, 560.0, 200.0
"""Size of the drawing."""
_BELOW = 32.0
"""Room for the scale bar, below it."""
_EDGE_M, _EDGE = 0.4, 0.15
"""Around a path: at least so much, and this share of its size."""
_TICKS = 8
_FARTHEST, _GAP_M = 2.5, 0.1
_FADE = (
    '<defs><filter id="blur"><feGaussianBlur stdDeviation="18"/></filter><mask id="fade">'
    '<rect x="5%" y="5%" width="90%" height="90%" fill="#fff" filter="url(#blur)"/></mask></defs>'
)
"""What goes on beyond the border fades towards it."""
_FADED = 'mask="url(#fade)"'


def outlines(scene: Scene, messages: Messages) -> list[Array]:
    """Return what each thing without joints covers on the ground, convex, shape (n, 2) each [m].

    Floors, more than 8 m in size, are left out.
    """
    poses, found = scene.world_poses(messages), []
    for body in scene.bodies:
        corners = [
            moved(visual.mesh.vertices.astype(float), poses[frame.name] @ visual.pose)[:, :2]
            for frame in scene.frames
            if frame.body == body.name and not frame.is_ghost and not body.model.has_joints
            for visual in frame.visuals
        ]
        if corners and float(np.ptp(np.concatenate(corners), axis=0).max()) < _FLOOR_M:
            found.append(hull(np.concatenate(corners)))
    return found


def hull(points: Array) -> Array:
    """Return the convex hull of points, shape (n, 2), counter-clockwise."""
    rows = [(float(x), float(y)) for x, y in np.unique(points.round(6), axis=0)]
    return np.array([*_chain(rows), *_chain(rows[::-1])] or rows)


def _chain(rows: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    kept: list[tuple[float, float]] = []
    for x, y in rows:
        while len(kept) > 1:
            (ax, ay), (bx, by) = kept[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                break
            kept.pop()
        kept.append((x, y))
    return kept[:-1]


@dataclass(frozen=True)
class _View:
    """What the drawing shows. middle: of it [m]. scale: pixels of a metre, on both axes."""

    middle: Array
    scale: float
    height: float

    @property
    def _ends(self) -> tuple[Array, Array]:
        half = np.array([_WIDTH, self.height]) / 2 / self.scale
        return self.middle - half, self.middle + half

    def shows(self, thing: Array) -> bool:
        """Return whether some of a thing is in the view."""
        low, high = self._ends
        return bool((thing.max(axis=0) > low).all() and (thing.min(axis=0) < high).all())

    def cuts(self, thing: Array) -> bool:
        """Return whether the border of the view goes through a thing."""
        low, high = self._ends
        whole = (thing.min(axis=0) >= low).all() and (thing.max(axis=0) <= high).all()
        return self.shows(thing) and not whole


def _view_of(low: Array, high: Array, things: Sequence[Array]) -> _View:
    """Return a view of a path from `low` to `high`, which grows by the things that it would cut.

    What would make it `_FARTHEST` times as large remains cut.
    """
    edge = max(_EDGE_M, _EDGE * float(np.max(high - low)))
    low, high = low - edge, high + edge
    most = _FARTHEST * float(np.max(high - low))
    rest = list(things)
    while True:
        width, depth = high - low
        scale = min(_WIDTH / width, _TALLEST / depth)
        view = _View((low + high) / 2, scale, max(_LOWEST, scale * depth))
        for thing in filter(view.cuts, rest):
            ends = (
                np.minimum(low, thing.min(axis=0) - _GAP_M),
                np.maximum(high, thing.max(axis=0) + _GAP_M),
            )
            if float(np.max(ends[1] - ends[0])) <= most:
                low, high = ends
                rest = [one for one in rest if one is not thing]
                break
        else:
            return view


def path_from_above(paths: Mapping[str, Array], things: Sequence[Array] = ()) -> str:
    """Return the paths of bases, x to the right and y up.

    paths: name → shape (p, 2) [m]. things: outlines of what stands in the world [m].
    """
    rows = np.concatenate([np.empty((0, 2)), *paths.values()])
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return ""
    low, high = rows.min(axis=0), rows.max(axis=0)
    view = _view_of(low, high, things)
    middle, scale, height = view.middle, view.scale, view.height
    place = np.array([_WIDTH / 2, height / 2])

    def at(points: Array) -> Array:
        placed: Array = place + (points - middle) * (scale, -scale)
        return placed

    parts = [*_grid(middle, scale, height)]
    parts += [_FADE] if any(view.cuts(thing) for thing in things) else []
    parts += [
        f'<polygon class="thing" {_FADED if view.cuts(thing) else ""} points="{_dots(at(thing))}"/>'
        for thing in things
        if view.shows(thing)
    ]
    for number, points in enumerate(paths.values()):
        kept = np.concatenate((points[:: max(1, len(points) // _MOST_POINTS)], points[-1:]))
        kept = at(kept[np.isfinite(kept).all(axis=1)])
        (sx, sy), (ex, ey) = kept[0], kept[-1]
        parts.append(
            f'<polyline class="l{number % 7}{" broken" if number else ""}" points="{_dots(kept)}"/>'
            f'<circle class="f{number % 7}" cx="{ex:.1f}" cy="{ey:.1f}" r="5"><title>end</title>'
            # Wider, so that it is seen around the end of a base that has come back.
            f'</circle><circle class="start" cx="{sx:.1f}" cy="{sy:.1f}" r="8">'
            "<title>start</title></circle>"
        )
    parts.append(_scale_bar(scale, height))
    width_m, height_m = (engineering(float(size), "m") for size in high - low)
    size = f"{_WIDTH:g} {height + _BELOW:.0f}"
    return (
        '<svg class="path" role="img" aria-label="path from above" viewBox="0 0 '
        f'{size}">{"".join(parts)}</svg>{legend(list(paths))}<p>{escape(width_m)} × '
        f"{escape(height_m)}; open circle: start, dot: end"
        f"{'; grey: obstacles' if len(things) else ''}</p>"
    )


def _dots(points: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _grid(middle: Array, scale: float, height: float) -> Iterator[str]:
    """Yield lines and numbers of both axes [m]."""
    half_x, half_y = _WIDTH / 2 / scale, height / 2 / scale
    # One distance for both, or squares would not look square.
    ticks = nice_ticks(middle[0] - half_x, middle[0] + half_x, _TICKS)
    step = ticks[1] - ticks[0] if len(ticks) > 1 else 2 * half_x
    for tick in ticks:
        x = _WIDTH / 2 + (tick - middle[0]) * scale
        yield f'<path class="grid" d="M{x:.1f} 0V{height:.0f}"/>'
        yield f'<text x="{x + 3:.1f}" y="{height - 5:.0f}">{_label(tick)}</text>'
    first = int(np.ceil((middle[1] - half_y) / step))
    for tick in (step * n for n in range(first, int((middle[1] + half_y) // step) + 1)):
        y = height / 2 - (tick - middle[1]) * scale
        yield f'<path class="grid" d="M0 {y:.1f}H{_WIDTH:g}"/>'
        yield f'<text x="4" y="{y - 3:.1f}">{_label(tick)}</text>'
    yield f'<text x="{_WIDTH - 42:g}" y="{height - 20:.0f}">x [m]</text>'
    yield '<text x="4" y="14">y [m]</text>'


def _label(tick: float) -> str:
    return f"{tick + 0.0:.4g}" if abs(tick) > 1e-9 else "0"


def _scale_bar(scale: float, height: float) -> str:
    length = nice_ticks(0.0, _WIDTH / 4 / scale, 2)[-1]
    long = length * scale
    x, y = _WIDTH - 20 - long, height + _BELOW / 2
    text = escape(engineering(length, "m"))
    return (
        f'<path class="scale" d="M{x:.1f} {y - 4:.0f}v8m0 -4h{long:.1f}m0 -4v8"/>'
        f'<text x="{x - 8:.1f}" y="{y + 4:.0f}" text-anchor="end">{text}</text>'
    )
