"""Where links truly are, as the physics engine has it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import pybullet as bullet

from stepbus_participant.settings import nearest
from stepbus_plant.world.file import World
from stepbus_plant.world.shapes import Look, read_looks
from stepbus_schemas import Description, Poses, WiringError
from stepbus_schemas.messages import Point, Quaternion

_BASE = -1
"""PyBullet's number of a body's first link."""

Place = tuple[int, int]
"""PyBullet's numbers of a body and one of its links."""


class PoseSensor:
    """Reads poses of links in the frame of the world, without noise.

    client: of PyBullet. bodies: names of its bodies, in its order. links: those to read; None:
    all. A link is named as in its URDF, and `body/link` where bodies share the name.
    Raises WiringError for links that are unknown.
    """

    def __init__(self, client: int, bodies: Sequence[str], links: Sequence[str] | None) -> None:
        self._client = client
        self._bodies = bodies
        known = link_places(client, bodies)
        self.names = list(known if links is None else links)
        unknown = [name for name in self.names if name not in known]
        if unknown:
            rows = (f"params.poses: link {n!r} is unknown; {nearest(n, known)}" for n in unknown)
            raise WiringError("\n".join(rows))
        self._places = [known[name] for name in self.names]
        self._bases = {body: self._to_urdf(body) for body, link in self._places if link == _BASE}
        self._links = {
            body: [link for other, link in self._places if other == body and link != _BASE]
            for body, link in self._places
            if link != _BASE
        }

    def _to_urdf(self, body: int) -> tuple[Point, Quaternion]:
        """Return the URDF's frame of a base; PyBullet tells of the centre of mass."""
        inertial = bullet.getDynamicsInfo(body, _BASE, self._client)[3:5]
        inverse: tuple[Point, Quaternion] = bullet.invertTransform(*inertial)
        return inverse

    def sense(self) -> Poses:
        """Return where the links are now."""
        found: dict[Place, tuple[Point, Quaternion]] = {}
        for body, inverse in self._bases.items():
            centre = bullet.getBasePositionAndOrientation(body, self._client)
            found[body, _BASE] = bullet.multiplyTransforms(*centre, *inverse)
        for body, links in self._links.items():
            states = bullet.getLinkStates(
                body, links, computeForwardKinematics=True, physicsClientId=self._client
            )
            for link, state in zip(links, states, strict=True):
                found[body, link] = state[4:6]
        rows = [found[place] for place in self._places]
        return Poses(
            position=[position for position, _ in rows],
            orientation=[orientation for _, orientation in rows],
        )

    def describe(self, world: World, urdfs: Sequence[bytes]) -> Description:
        """Return the names of the links, and what stands still about each of them.

        urdfs: models of all bodies, in the engine's order. Raises WiringError for one with shapes
        that cannot be understood.
        """
        looks = {body: _read_looks(self._bodies[body], urdfs[body]) for body, _ in self._places}
        rows = [(self._bodies[body], self._look(looks, body, n)) for body, n in self._places]
        return Description(
            names=self.names,
            details={
                "shape": [look.shape for _, look in rows],
                "body": [body for body, _ in rows],
                "kind": [world.kinds.get(body, "") for body, _ in rows],
                "color": [look.color if world.bodies[body].visuals else "" for body, look in rows],
            },
        )

    def _look(self, looks: Mapping[int, Mapping[str, Look]], body: int, link: int) -> Look:
        names = {number: name for name, number in _links_of(self._client, body)}
        return looks[body].get(names[link], Look())


def link_places(client: int, bodies: Sequence[str]) -> dict[str, Place]:
    """Return each link's unique name → where it is in the engine."""
    found = [
        (body, name, (number, link))
        for number, body in enumerate(bodies)
        for name, link in _links_of(client, number)
    ]
    counts = Counter(name for _, name, _ in found)
    return {name if counts[name] == 1 else f"{body}/{name}": at for body, name, at in found}


def _read_looks(body: str, urdf: bytes) -> Mapping[str, Look]:
    try:
        return read_looks(urdf)
    except WiringError as exc:
        raise WiringError(f"bodies.{body}.urdf: {exc}") from exc


def _links_of(client: int, body: int) -> list[tuple[str, int]]:
    base: str = bullet.getBodyInfo(body, client)[0].decode()
    count = bullet.getNumJoints(body, physicsClientId=client)
    infos = [bullet.getJointInfo(body, number, client) for number in range(count)]
    return [(base, _BASE), *((info[12].decode(), info[0]) for info in infos)]
