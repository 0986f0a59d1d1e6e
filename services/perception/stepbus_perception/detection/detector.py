"""Finds the items of known kinds in a view."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stepbus_perception.geometry import Pose, rotation, turn_about_z
from stepbus_perception.images import View
from stepbus_perception.items import Face, Goods, Kind
from stepbus_schemas import WiringError

from .checking import seen_share
from .colours import Palette
from .faces import Mask, Patch, Scene
from .outlines import fit
from .splitting import split

_RMS = 1.5e-3
"""Edge points may miss the outline by this much before it counts against a find [m]."""
_EXPLAINED = 0.5
"""A face that fits no top as a whole with this confidence may be several that touch."""
_FEWEST_EDGES = 8
_SHARES = (0.05, 1.3)
"""A face is fitted where the seen area is between these shares of its own."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """An item that was found.

    position: of its centre [m]; yaw: of its link [rad]; both in the frame of the search.
    confidence: 0 to 1.
    """

    kind: str
    position: tuple[float, float, float]
    yaw: float
    confidence: float


@dataclass(frozen=True, kw_only=True)
class _Candidate:
    """What may be there.

    reach: from its axis to its outer edge [m]. edges: how many points it was fitted to.
    """

    found: Found
    reach: float
    edges: int

    @property
    def merit(self) -> float:
        """Return the confidence less the error of the mean of its edge points."""
        return self.found.confidence * float(1 - 1 / np.sqrt(self.edges))

    def excludes(self, other: _Candidate) -> bool:
        """Return whether it stands where another one stands."""
        apart = np.subtract(self.found.position[:2], other.found.position[:2])
        return bool(np.hypot(*apart) < max(self.reach, other.reach))


class Detector:
    """Looks for the tops of items: colour first, then horizontal faces of the right outline.

    min_confidence: finds below it are dropped.
    Raises WiringError for kinds that have no top to look for.
    """

    def __init__(self, goods: Goods, min_confidence: float) -> None:
        flat = [kind.name for kind in goods.kinds if not kind.faces]
        if flat:
            raise WiringError(
                f"{', '.join(flat)}: the camera finds kinds by a box or a cylinder that stands "
                "upright, and there is none"
            )
        self._palette = Palette([kind.color for kind in goods.kinds], goods.others)
        self._classes = [
            [kind for kind in goods.kinds if kind.color == color] for color in self._palette.classes
        ]
        self._min_confidence = min_confidence

    def find(self, view: View, camera: Pose) -> list[Found]:
        """Return the items in a view, by kind, then from near to far along x.

        camera: where the optical frame is in a frame whose z is up; the finds are in that frame.
        """
        scene = Scene(view, camera)
        numbers = self._palette.classify(view.rgb)
        found = [
            item
            for number, kinds in enumerate(self._classes)
            for item in _best([*_candidates(scene, numbers == number, kinds)])
            if item.confidence >= self._min_confidence
        ]
        return sorted(found, key=lambda item: (item.kind, item.position))


def _candidates(scene: Scene, among: Mask, kinds: Sequence[Kind]) -> Iterator[_Candidate]:
    """Yield what the faces within a mask may belong to."""
    for patch in scene.patches(among):
        whole = [*_fits(scene, among, [patch], kinds)]
        yield from whole
        if all(candidate.found.confidence < _EXPLAINED for candidate in whole):
            for kind in kinds:
                for face in kind.faces:
                    yield from _fits(scene, among, split(patch, face.outline.area), [kind])


def _fits(
    scene: Scene, among: Mask, patches: Sequence[Patch], kinds: Sequence[Kind]
) -> Iterator[_Candidate]:
    """Yield faces as each of the tops that they are large enough for."""
    for patch in patches:
        for kind in kinds:
            for face in kind.faces:
                share = patch.area / face.outline.area
                if len(patch.edge) >= _FEWEST_EDGES and _SHARES[0] < share < _SHARES[1]:
                    found = _find(scene, among, patch, kind, face)
                    reach = max(other.outline.reach for other in kind.faces)
                    yield _Candidate(found=found, reach=reach, edges=len(patch.edge))


def _find(scene: Scene, among: Mask, patch: Patch, kind: Kind, face: Face) -> Found:
    where = fit(face.outline, patch.points, patch.edge)
    yaw = face.outline.canonical(where.yaw - face.yaw)
    axes = rotation(turn_about_z(yaw))
    origin = np.array([*where.centre, patch.height]) - axes @ face.offset
    blur = min(1.0, (_RMS / max(where.rms, 1e-9)) ** 2)
    x, y, z = (origin + axes @ kind.centre).tolist()
    return Found(
        kind=kind.name,
        position=(x, y, z),
        yaw=yaw,
        confidence=blur * seen_share(scene, among, kind, Pose(rotation=axes, position=origin)),
    )


def _best(candidates: Sequence[_Candidate]) -> Iterator[Found]:
    """Yield the best of those that cannot both be there."""
    kept: list[_Candidate] = []
    for candidate in sorted(candidates, key=lambda c: (-c.merit, c.found.kind, c.found.position)):
        if not any(candidate.excludes(other) for other in kept):
            kept.append(candidate)
            yield candidate.found
