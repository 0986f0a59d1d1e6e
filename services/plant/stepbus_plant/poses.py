"""Where links truly are, as the physics engine has it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import pybullet as bullet

from stepbus.settings import nearest
from stepbus_schemas import Poses, WiringError

_BASE = -1
"""PyBullet's number of a body's first link."""


class PoseSensor:
    """Reads poses of links in the frame of the world, without noise.

    client: of PyBullet. bodies: names of its bodies, in its order. links: those to read; None:
    all. A link is named as in its URDF, and `body/link` where bodies share the name.
    Raises WiringError for links that are unknown.
    """

    def __init__(self, client: int, bodies: Sequence[str], links: Sequence[str] | None) -> None:
        self._client = client
        known = _links(client, bodies)
        self.names = list(known if links is None else links)
        unknown = [name for name in self.names if name not in known]
        if unknown:
            rows = (f"params.poses: link {n!r} is unknown; {nearest(n, known)}" for n in unknown)
            raise WiringError("\n".join(rows))
        self._places = [known[name] for name in self.names]

    def sense(self) -> Poses:
        """Return where the links are now."""
        rows = [self._pose(body, link) for body, link in self._places]
        return Poses(
            position=[position for position, _ in rows],
            orientation=[orientation for _, orientation in rows],
        )

    def _pose(
        self, body: int, link: int
    ) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
        if link == _BASE:
            # PyBullet tells of the centre of mass; the frame of the URDF is what people mean.
            centre = bullet.getBasePositionAndOrientation(body, self._client)
            inertial = bullet.getDynamicsInfo(body, link, self._client)[3:5]
            position, orientation = bullet.multiplyTransforms(
                *centre, *bullet.invertTransform(*inertial)
            )
        else:
            state = bullet.getLinkState(
                body, link, computeForwardKinematics=True, physicsClientId=self._client
            )
            position, orientation = state[4:6]
        return position, orientation


def _links(client: int, bodies: Sequence[str]) -> dict[str, tuple[int, int]]:
    """Return each link's unique name → PyBullet's numbers of body and link."""
    found = [
        (body, name, (number, link))
        for number, body in enumerate(bodies)
        for name, link in _links_of(client, number)
    ]
    counts = Counter(name for _, name, _ in found)
    return {name if counts[name] == 1 else f"{body}/{name}": at for body, name, at in found}


def _links_of(client: int, body: int) -> list[tuple[str, int]]:
    base: str = bullet.getBodyInfo(body, client)[0].decode()
    count = bullet.getNumJoints(body, physicsClientId=client)
    infos = [bullet.getJointInfo(body, number, client) for number in range(count)]
    return [(base, _BASE), *((info[12].decode(), info[0]) for info in infos)]
