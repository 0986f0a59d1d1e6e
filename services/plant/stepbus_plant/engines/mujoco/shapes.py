"""What touches, what is near, and what rays hit."""

import math
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from stepbus_plant.engine import Contact, Link
from stepbus_plant.engines.mujoco.model import BOTH, SOLID
from stepbus_plant.geometry import Array
from stepbus_schemas import Point

_SOLID = np.array([n in (BOTH, SOLID) for n in range(6)], dtype=np.uint8)


class Shapes:
    """The collision shapes of a compiled model, where its data has them; numbers: of its links."""

    def __init__(self, model: Any, data: Any, numbers: Mapping[Link, int]) -> None:
        self._model, self._data = model, data
        # A link with several joints has more than one number, of which contacts have the last.
        links = {number: link for link, number in numbers.items()}
        shapes = [n for n in range(model.ngeom) if _SOLID[model.geom_group[n]]]
        self._link_of = [links.get(int(body), (-1, -1)) for body in model.geom_bodyid]
        self._shapes = np.array(shapes, dtype=np.int64)
        self._geoms: dict[Link, list[int]] = {}
        for n in shapes:
            self._geoms.setdefault(self._link_of[n], []).append(n)

    def contacts(self, *, has_forces: bool) -> list[Contact]:
        """Return the contacts that MuJoCo has found."""
        model, data = self._model, self._data
        found, link = data.contact, self._link_of
        # The first axis of a frame points from the first shape to the second one.
        normals = found.frame[:, :3]
        halves = (0.5 * found.dist)[:, np.newaxis] * normals
        forces, wrench = np.zeros(len(normals)), np.zeros(6)
        for n in range(len(normals) if has_forces else 0):
            mujoco.mj_contactForce(model, data, n, wrench)
            forces[n] = wrench[0]
        vectors = [_points(rows) for rows in (found.pos - halves, found.pos + halves, -normals)]
        links = ((link[one], link[other]) for one, other in found.geom.tolist())
        numbers = found.dist.tolist(), forces.tolist()
        return [Contact(*pair, *row) for pair, *row in zip(links, *vectors, *numbers, strict=True)]

    def closest(self, link: Link, within: float) -> list[Contact]:
        """Return the nearest points of a link and of others, as of `Engine`."""
        (low, high), found = self._boxes(), []
        for n in np.flatnonzero(np.isin(self._shapes, self._geoms.get(link, ()))):
            near = ((low - within <= high[n]) & (high + within >= low[n])).all(axis=1)
            for geom in self._shapes[near].tolist():
                ends, other = np.zeros(6), self._link_of[geom]
                if other[0] == link[0]:
                    continue
                distance = mujoco.mj_geomDistance(
                    self._model, self._data, self._shapes[n], geom, within, ends
                )
                if distance < within:
                    on_one, on_other = ends[:3], ends[3:]
                    gap = on_one - on_other
                    length = float(np.linalg.norm(gap)) or 1.0
                    normal = gap * (math.copysign(1.0, distance) / length)
                    points = point(on_one), point(on_other), point(normal)
                    found.append(Contact(link, other, *points, float(distance), 0.0))
        return sorted(found, key=lambda contact: contact.other)

    def box(self, link: Link) -> tuple[Point, Point] | None:
        """Return the corners of the box around the shapes of a link [m]; None: it has none."""
        own = np.isin(self._shapes, self._geoms.get(link, ()))
        if not own.any():
            return None
        low, high = self._boxes()
        return point(low[own].min(axis=0)), point(high[own].max(axis=0))

    def _boxes(self) -> tuple[Array, Array]:
        """Return the corners of the boxes of all shapes, shape (n, 3) each.

        That of a mesh lies along the axes of its inertia, and is too large where these turn.
        """
        model, data, shapes = self._model, self._data, self._shapes
        turns = data.geom_xmat[shapes].reshape(-1, 3, 3)
        centres = data.geom_xpos[shapes] + np.einsum(
            "nij,nj->ni", turns, model.geom_aabb[shapes, :3]
        )
        halves = np.einsum("nij,nj->ni", np.abs(turns), model.geom_aabb[shapes, 3:])
        halves[model.geom_type[shapes] == mujoco.mjtGeom.mjGEOM_PLANE] = np.inf
        low, high = centres - halves, centres + halves
        return low, high

    def cast(self, starts: Array, ends: Array) -> Array:
        """Return how far along each ray the first hit is, as of `Engine`."""
        hit = np.zeros(1, dtype=np.int32)
        shares = np.empty(len(starts))
        for n, (start, along) in enumerate(zip(starts, ends - starts, strict=True)):
            share = mujoco.mj_ray(self._model, self._data, start, along, _SOLID, True, -1, hit)
            shares[n] = share if 0.0 <= share <= 1.0 else math.inf
        return shares


def point(values: Array) -> Point:
    """Return three numbers of an array."""
    x, y, z = values.tolist()
    return x, y, z


def _points(rows: Array) -> list[Point]:
    return [(x, y, z) for x, y, z in rows.tolist()]
