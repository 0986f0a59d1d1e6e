"""Where the items truly are, in place of a camera."""

from __future__ import annotations

import math
from collections.abc import Sequence

from stepbus_participant.settings import nearest
from stepbus_schemas import Detections, Poses, RunError, WiringError

from .geometry import Vector, inverse_times, rotation
from .items import Goods


class Truth:
    """Turns ground truth into detections of every item.

    port: name of the input with the poses, for messages. links: names of its links. frame: link
    that the detections are given in.
    Raises WiringError when the frame is none of the links.
    """

    def __init__(self, port: str, links: Sequence[str], goods: Goods, frame: str) -> None:
        if frame not in links:
            raise WiringError(f"input {port!r} has no link {frame!r}; {nearest(frame, links)}")
        self._port = port
        self._links = list(links)
        self._count = len(links)
        self._name = frame
        self._frame = links.index(frame)
        self._items = [(links.index(link), kind) for link, kind in goods.items.items()]
        self._centres = {kind.name: kind.centre for kind in goods.kinds}

    def detections(self, poses: Poses) -> Detections:
        """Return all items, in the order of the links, with confidence 1.

        Raises RunError for poses of another number of links, or one that is no pose.
        """
        if len(poses.position) != self._count or len(poses.orientation) != self._count:
            raise RunError(
                f"input {self._port!r}: {self._count} poses expected, {len(poses.position)} came"
            )
        places = [number for number, _ in self._items]
        self._check(poses, [self._frame, *places])
        origin, turned = poses.position[self._frame], poses.orientation[self._frame]
        axes = rotation(turned)
        centres = [self._centre(poses, number, kind) - origin for number, kind in self._items]
        return Detections(
            frame=self._name,
            types=[kind for _, kind in self._items],
            position=[tuple((centre @ axes).tolist()) for centre in centres],
            orientation=[inverse_times(turned, poses.orientation[n]) for n in places],
            confidence=[1.0] * len(places),
        )

    def _check(self, poses: Poses, places: Sequence[int]) -> None:
        """Raise RunError for a pose that is none."""
        for place in places:
            position, turned = poses.position[place], poses.orientation[place]
            if not (math.isfinite(sum(position)) and 0.0 < math.hypot(*turned) < math.inf):
                raise RunError(
                    f"input {self._port!r}: {position}, {turned} of {self._links[place]} is no pose"
                )

    def _centre(self, poses: Poses, number: int, kind: str) -> Vector:
        """Return where the centre of an item is in the world, shape (3,) [m]."""
        turned = rotation(poses.orientation[number]) @ self._centres[kind]
        centre: Vector = poses.position[number] + turned
        return centre
