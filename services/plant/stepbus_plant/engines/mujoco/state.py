"""The state of a world, as bytes."""

import msgspec

from stepbus_plant.engine import Contact, Link


class State(msgspec.Struct, forbid_unknown_fields=True):
    """All that the next substep, or a reading before it, depends on.

    physics: MuJoCo's own, of mjSTATE_INTEGRATION. motors: rows of `Motors.save`. drift: velocities
    of standing bodies that are moved [m/s, rad/s]. reactions: force [N] and torque [N·m] of joints.
    """

    physics: list[float]
    motors: list[list[float]]
    drift: dict[int, tuple[list[float], list[float]]]
    reactions: list[tuple[Link, list[float], list[float]]]
    contacts: list[Contact]

    def encode(self) -> bytes:
        """Return the bytes."""
        return msgspec.msgpack.encode(self)

    @classmethod
    def decode(cls, data: bytes) -> "State":
        """Return the state of bytes."""
        return msgspec.msgpack.decode(data, type=cls)
