"""Finds the items of known types in a view."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pinocchio as pin

from stepbus_kinematics import Vector
from stepbus_schemas import Quaternion, WiringError
from stepbus_store.perception.faces import Mask, Patch, Scene
from stepbus_store.perception.images import View, turn_about_z
from stepbus_store.perception.item_catalog import MARGIN, Catalog, Face, ItemType
from stepbus_store.perception.outlines import fit
from stepbus_store.perception.segments import Palette, denoised, split, visible_share
from stepbus_store.solids import rotation

_RMS = 1.5e-3
"""RMS distance of edge points from the outline that does not reduce the confidence [m]."""
_EXPLAINED = 0.5
"""A patch that fits no single face with this confidence may be several faces that touch."""
_FEWEST_EDGES = 8
_AROUND = np.array(
    [(x, y, 0.0) for x in np.linspace(-0.02, 0.02, 5) for y in np.linspace(-0.02, 0.02, 5)]
)
"""Where a spot is looked at, around its middle [m]."""
_SHARES = (0.05, 1.3)
"""A face is fitted to a patch if the visible area is between these shares of its own."""


@dataclass(frozen=True, kw_only=True)
class Detection:
    """A detected item.

    position: of its centre [m]. yaw: of its link, or where it lies, of its axis [rad]. Both are in
    the frame of the scene. confidence: 0 to 1.
    """

    type: str
    position: tuple[float, float, float]
    yaw: float
    confidence: float
    lies: bool = False

    @property
    def orientation(self) -> Quaternion:
        """Return its orientation, x, y, z, w; where it lies, its axis z is horizontal."""
        if not self.lies:
            return turn_about_z(self.yaw)
        half = math.sqrt(0.5)
        return (-half * math.sin(self.yaw), half * math.cos(self.yaw), 0.0, half)


@dataclass(frozen=True, kw_only=True)
class _Candidate:
    """A possible detection.

    reach: from its axis to its outer edge [m]. edges: number of edge points fitted.
    """

    detection: Detection
    reach: float
    edges: int

    @property
    def merit(self) -> float:
        """Return the confidence, reduced by the standard error of the fit."""
        return self.detection.confidence * float(1 - 1 / np.sqrt(self.edges))

    def excludes(self, other: _Candidate) -> bool:
        """Return whether it overlaps another one."""
        apart = np.subtract(self.detection.position[:2], other.detection.position[:2])
        return bool(np.hypot(*apart) < max(self.reach, other.reach))


_FEWEST_PIXELS = 60
_LONGER = 1.15
"""By this factor longer than it is wide, what is seen cannot stand upright."""
_LONGEST = 1.3
"""By this factor longer than the item, it is something else."""
_TOP = 98
"""Percentile of the heights that counts as the top, since there is noise."""
_NOISE = 0.05
"""Share of the surroundings that may be lower than that by mistake."""
_FEW, _SIDES = 5, 3
"""Pixels on one of four sides, and sides, that have to show the ground that it would reach into."""
_APART, _RING = 4e-3, 0.02
"""Distances from an item between which its surroundings are looked at [m]."""
_NEAR = 0.15
"""Half the side of the square around an item in which they are [m]."""
_DEEP = 0.015
"""By more, an item does not reach into the ground [m]."""


def is_sunk(scene: Scene, others: Mask, item: Detection, item_type: ItemType) -> bool:
    """Return whether an upright item would reach into the surfaces all around it.

    What lies shows faces that may pass for those of an item that stands, and is too low for that.
    others: pixels of another colour, shape (h, w).
    """
    near = scene.flat_near(others, item.position, _NEAR)
    away = _beyond(item, item_type, near)
    around = near[(away > _APART) & (away < _RING)] - item.position
    tall = item_type.faces[0].offset[2] - item_type.centre[2]
    depth = around[:, 2] + tall
    if (depth < _DEEP).sum() > _NOISE * len(depth):
        return False
    between = around[(depth > _DEEP) & (depth < 2 * tall - _DEEP)]
    _, pixels = np.unique(between[:, :2] > 0.0, axis=0, return_counts=True)
    return int((pixels >= _FEW).sum()) >= _SIDES


def _beyond(item: Detection, item_type: ItemType, points: Vector) -> Vector:
    """Return how far beside an upright item points are, shape (n, 3) [m]; below 0: over it."""
    axes = rotation(turn_about_z(item.yaw))
    return item_type.beyond((points - item.position) @ axes + item_type.centre)


def lying(
    scene: Scene, among: Mask, types: Mapping[str, ItemType], upright: Sequence[Detection]
) -> Iterator[Detection]:
    """Yield the items that lie within a mask, shape (h, w), of the colour of some types."""
    rows, columns, points = scene.points(among)
    free = np.ones(len(points), dtype=bool)
    for item in upright:
        free &= _beyond(item, types[item.type], points) >= MARGIN
    left = np.zeros(among.shape, dtype=np.uint8)
    left[rows[free], columns[free]] = 1
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(left, connectivity=8)
    own = labels[rows, columns]
    height, width = among.shape
    for number, (x, y, wide, high, pixels) in enumerate(boxes.tolist()):
        # What reaches the rim may be the visible part of anything.
        is_whole = x > 0 and y > 0 and x + wide < width and y + high < height
        if number and is_whole and pixels >= _FEWEST_PIXELS:
            yield from _fitting(points[free & (own == number)], types.values())


def _fitting(points: Vector, types: Iterable[ItemType]) -> Iterator[Detection]:
    """Yield the item that lies where points are, shape (n, 3) [m], if it is one of these types."""
    flat = points[:, :2]
    spread = np.linalg.eigh(np.cov((flat - flat.mean(axis=0)).T))
    axis = spread.eigenvectors[:, -1]
    along, across = flat @ axis, flat @ (-axis[1], axis[0])
    length, width = float(np.ptp(along)), float(np.ptp(across))
    for item_type in types:
        top, centre = item_type.faces[0].offset[2], item_type.centre[2]
        tall, thick = 2.0 * (top - centre), 2.0 * max(f.outline.reach for f in item_type.faces)
        if _LONGER * max(thick, width) < length < _LONGEST * tall:
            middle = axis * (along.max() + along.min()) / 2
            middle = middle + np.array([-axis[1], axis[0]]) * (across.max() + across.min()) / 2
            z = float(np.percentile(points[:, 2], _TOP)) - width / 2
            yield Detection(
                type=item_type.name,
                position=(float(middle[0]), float(middle[1]), z),
                yaw=math.atan2(axis[1], axis[0]),
                confidence=min(1.0, length / tall),
                lies=True,
            )
            return


class Detector:
    """Detects the top faces of items: first by colour, then by outline.

    min_confidence: detections below it are dropped. depth_noise: standard deviation of depth at
    1 m, which grows with the square of the distance; 0: images are taken as they are [m].
    Raises WiringError for types without a top face.
    """

    def __init__(self, catalog: Catalog, min_confidence: float, depth_noise: float = 0.0) -> None:
        flat = [item_type.name for item_type in catalog.types if not item_type.faces]
        if flat:
            raise WiringError(
                f"the camera cannot detect item types {', '.join(flat)}: they have no upright box "
                "or cylinder; add one to their collision shapes"
            )
        self._palette = Palette([item_type.color for item_type in catalog.types], catalog.others)
        self._classes = [
            [item_type for item_type in catalog.types if item_type.color == color]
            for color in self._palette.classes
        ]
        self._min_confidence = min_confidence
        self._depth_noise = depth_noise

    def look(
        self, view: View, camera: Any, spot: tuple[float, float, float] | None = None
    ) -> tuple[list[Detection], float]:
        """Return the items in a view, by type, then by x, and the share of a spot that is hidden.

        camera: pose of the optical frame in a frame with z up, a `pinocchio.SE3`; the detections
        are in that frame. spot: in that frame [m]; None: nothing is hidden.
        """
        if self._depth_noise:
            view = denoised(view, self._depth_noise)
        scene = Scene(view, camera)
        numbers = self._palette.classify(view.rgb)
        detections = [
            item
            for number, types in enumerate(self._classes)
            for item in self._of_color(scene, numbers == number, types)
        ]
        hidden = 0.0 if spot is None else scene.hidden(spot + _AROUND)
        return sorted(detections, key=lambda item: (item.lies, item.type, item.position)), hidden

    def _of_color(
        self, scene: Scene, among: Mask, types: Sequence[ItemType]
    ) -> Iterator[Detection]:
        """Yield the items within a mask, those that stand first."""
        by_name = {item_type.name: item_type for item_type in types}
        upright = [
            item
            for item in _best([*_candidates(scene, among, types)])
            if item.confidence >= self._min_confidence
            and not is_sunk(scene, ~among, item, by_name[item.type])
        ]
        yield from upright
        yield from lying(scene, among, by_name, upright)


def _candidates(scene: Scene, among: Mask, types: Sequence[ItemType]) -> Iterator[_Candidate]:
    """Yield the items that the patches within a mask may belong to."""
    for patch in scene.patches(among):
        whole = [*_fits(scene, among, [patch], types)]
        yield from whole
        if all(candidate.detection.confidence < _EXPLAINED for candidate in whole):
            for item_type in types:
                for face in item_type.faces:
                    yield from _fits(scene, among, split(patch, face.outline.area), [item_type])


def _fits(
    scene: Scene, among: Mask, patches: Sequence[Patch], types: Sequence[ItemType]
) -> Iterator[_Candidate]:
    """Yield a candidate for each top face that a patch may show."""
    for patch in patches:
        for item_type in types:
            for face in item_type.faces:
                share = patch.area / face.outline.area
                if len(patch.edge) >= _FEWEST_EDGES and _SHARES[0] < share < _SHARES[1]:
                    detection = _find(scene, among, patch, item_type, face)
                    reach = max(other.outline.reach for other in item_type.faces)
                    yield _Candidate(detection=detection, reach=reach, edges=len(patch.edge))


def _find(scene: Scene, among: Mask, patch: Patch, item_type: ItemType, face: Face) -> Detection:
    fitted = fit(face.outline, patch.points, patch.edge)
    yaw = face.outline.canonical(fitted.yaw - face.yaw)
    axes = rotation(turn_about_z(yaw))
    origin = np.array([*fitted.centre, patch.height]) - axes @ face.offset
    sharpness = min(1.0, (_RMS / max(fitted.rms, 1e-9)) ** 2)
    x, y, z = (origin + axes @ item_type.centre).tolist()
    return Detection(
        type=item_type.name,
        position=(x, y, z),
        yaw=yaw,
        confidence=sharpness * visible_share(scene, among, item_type, pin.SE3(axes, origin)),
    )


def _best(candidates: Sequence[_Candidate]) -> Iterator[Detection]:
    """Yield the best of the candidates that overlap."""
    kept: list[_Candidate] = []
    for candidate in sorted(
        candidates, key=lambda c: (-c.merit, c.detection.type, c.detection.position)
    ):
        if not any(candidate.excludes(other) for other in kept):
            kept.append(candidate)
            yield candidate.detection
