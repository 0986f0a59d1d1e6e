"""Detections from the truth of the simulation, for comparison."""

from collections.abc import Sequence

from stepbus_participant import suggest
from stepbus_schemas import Detections, Poses, Quaternion, WiringError
from stepbus_store.perception.item_catalog import Catalog
from stepbus_store.poses import check_poses
from stepbus_store.solids import rotation


class Truth:
    """Turns true poses into detections of every item.

    port: name of the input with the poses, for messages. links: names of its links. frame: link
    that the detections are given in. prefix: what its name begins with among the links.
    Raises WiringError unless the frame is one of the links.
    """

    def __init__(
        self, port: str, links: Sequence[str], catalog: Catalog, frame: str, prefix: str = ""
    ) -> None:
        link = prefix + frame
        if link not in links:
            raise WiringError(f"input {port!r} has no link {link!r}{suggest(link, links)}")
        self._port = port
        self._links = list(links)
        self._name, self._frame = frame, links.index(link)
        centres = {item_type.name: item_type.centre for item_type in catalog.types}
        items = catalog.items.items()
        self._items = [(name, links.index(link), centres[name]) for link, name in items]

    def detections(self, poses: Poses) -> Detections:
        """Return all items, in the order of the links, with confidence 1.

        Raises RunError for a wrong number of poses, and for an invalid one.
        """
        check_poses(self._port, self._links, poses)
        at, turns = poses.position, poses.orientation
        origin, turn = at[self._frame], turns[self._frame]
        axes = rotation(turn)
        centres = [at[n] + rotation(turns[n]) @ centre - origin for _, n, centre in self._items]
        return Detections(
            frame=self._name,
            types=[name for name, _, _ in self._items],
            position=[tuple((centre @ axes).tolist()) for centre in centres],
            orientation=[_inverse_times(turn, turns[n]) for _, n, _ in self._items],
            confidence=[1.0] * len(self._items),
        )


def _inverse_times(one: Sequence[float], other: Sequence[float]) -> Quaternion:
    """Return conj(one)·other, the orientation of `other` in `one`; quaternions x, y, z, w."""
    ax, ay, az, aw = -one[0], -one[1], -one[2], one[3]
    bx, by, bz, bw = other
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
