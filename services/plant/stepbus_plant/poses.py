"""True poses of links, read from the physics engine."""

from collections import Counter
from collections.abc import Mapping, Sequence

import pybullet as bullet

from stepbus_participant import suggest
from stepbus_plant.appearance import Appearance, read_appearances
from stepbus_plant.world_file import World
from stepbus_schemas import Description, Point, Poses, Quaternion, WiringError

_BASE = -1
"""PyBullet's number of a body's root link."""

LinkIndex = tuple[int, int]
"""PyBullet's numbers of a body and one of its links."""


class PoseSensor:
    """Reads poses of links in the world frame, without noise.

    client: of PyBullet. bodies: names of its bodies, in its order. links: those to read; None:
    all. A link is named as in its URDF, or `body/link` if bodies share the name. points: name →
    link and position in its frame [m]; they are read as links are.
    Raises WiringError for unknown links.
    """

    def __init__(
        self,
        client: int,
        bodies: Sequence[str],
        links: Sequence[str] | None,
        points: Mapping[str, tuple[str, Point]] = {},
    ) -> None:
        self._client = client
        self._bodies = bodies
        known = link_indices(client, bodies)
        self._offsets = {name: offset for name, (_, offset) in points.items()}
        taken = [name for name in points if name in known]
        astray = [(name, link) for name, (link, _) in points.items() if link not in known]
        lines = [f"params.points: {name!r} is the name of a link" for name in taken]
        lines += [
            f"params.points.{name}: link {link!r} is unknown{suggest(link, known)}"
            for name, link in astray
        ]
        if lines:
            raise WiringError("\n".join(lines))
        known |= {name: known[link] for name, (link, _) in points.items()}
        self.names = list(known if links is None else links)
        unknown = [name for name in self.names if name not in known]
        if unknown:
            lines = [f"params.poses: link {n!r} is unknown{suggest(n, known)}" for n in unknown]
            raise WiringError("\n".join(lines))
        self._indices = [known[name] for name in self.names]
        self._bases = {body: self._to_urdf(body) for body, link in self._indices if link == _BASE}
        self._links = {
            body: [link for other, link in self._indices if other == body and link != _BASE]
            for body, link in self._indices
            if link != _BASE
        }

    def _to_urdf(self, body: int) -> tuple[Point, Quaternion]:
        """Return the URDF frame of a root link in the frame of its centre of mass."""
        inertial = bullet.getDynamicsInfo(body, _BASE, self._client)[3:5]
        inverse: tuple[Point, Quaternion] = bullet.invertTransform(*inertial)
        return inverse

    def sense(self) -> Poses:
        """Return the current poses of the links."""
        by_link: dict[LinkIndex, tuple[Point, Quaternion]] = {}
        for body, inverse in self._bases.items():
            centre = bullet.getBasePositionAndOrientation(body, self._client)
            by_link[body, _BASE] = bullet.multiplyTransforms(*centre, *inverse)
        for body, links in self._links.items():
            states = bullet.getLinkStates(
                body, links, computeForwardKinematics=True, physicsClientId=self._client
            )
            for link, state in zip(links, states, strict=True):
                by_link[body, link] = state[4:6]
        poses = [
            self._moved(name, by_link[index])
            for name, index in zip(self.names, self._indices, strict=True)
        ]
        return Poses(
            position=[position for position, _ in poses],
            orientation=[orientation for _, orientation in poses],
        )

    def _moved(self, name: str, pose: tuple[Point, Quaternion]) -> tuple[Point, Quaternion]:
        """Return the pose of a point of a link; that of the link where it is none."""
        offset = self._offsets.get(name)
        if offset is None:
            return pose
        position, _ = bullet.multiplyTransforms(*pose, offset, (0.0, 0.0, 0.0, 1.0))
        return position, pose[1]

    def describe(self, world: World, urdfs: Sequence[bytes]) -> Description:
        """Return the names of the links and their constant properties.

        urdfs: models of all bodies, in the engine's order. Raises WiringError for one with shapes
        that cannot be parsed.
        """
        bodies = [self._bodies[body] for body, _ in self._indices]
        shown = self._appearances(urdfs)
        return Description(
            names=self.names,
            details={
                "shape": [link.shape for link in shown],
                "body": bodies,
                "type": [world.items[body].type if body in world.items else "" for body in bodies],
                "color": [
                    link.color if world.bodies[body].visuals else ""
                    for body, link in zip(bodies, shown, strict=True)
                ],
            },
        )

    def _appearances(self, urdfs: Sequence[bytes]) -> list[Appearance]:
        """Return the appearance of each link."""
        appearances: dict[LinkIndex, Appearance] = {}
        for body in dict.fromkeys(body for body, _ in self._indices):
            by_name = _read_appearances(self._bodies[body], urdfs[body])
            links = _links_of(self._client, body)
            appearances |= {(body, n): by_name.get(name, Appearance()) for name, n in links}
        return [
            Appearance() if name in self._offsets else appearances[index]
            for name, index in zip(self.names, self._indices, strict=True)
        ]


def link_indices(client: int, bodies: Sequence[str]) -> dict[str, LinkIndex]:
    """Return each link's unique name → its index in the engine."""
    indices = [
        (body, name, (number, link))
        for number, body in enumerate(bodies)
        for name, link in _links_of(client, number)
    ]
    counts = Counter(name for _, name, _ in indices)
    return {name if counts[name] == 1 else f"{body}/{name}": index for body, name, index in indices}


def _read_appearances(body: str, urdf: bytes) -> Mapping[str, Appearance]:
    try:
        return read_appearances(urdf)
    except WiringError as exc:
        raise WiringError(f"bodies.{body}.urdf: {exc}") from exc


def _links_of(client: int, body: int) -> list[tuple[str, int]]:
    base: str = bullet.getBodyInfo(body, client)[0].decode()
    count = bullet.getNumJoints(body, physicsClientId=client)
    infos = [bullet.getJointInfo(body, number, client) for number in range(count)]
    return [(base, _BASE), *((info[12].decode(), info[0]) for info in infos)]
