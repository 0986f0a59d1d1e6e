"""A force-torque sensor at a joint."""

import numpy as np
import pybullet as bullet

from stepbus_plant.devices.poses import LinkIndex
from stepbus_plant.world.sensors import WrenchSettings
from stepbus_schemas import Description, Wrench

from .errors import Errors
from .frames import point, rotation_of


class WrenchSensor:
    """Measures what everything beyond a joint exerts on it, in the frame of the joint's child link.

    PyBullet reports the reaction of the latest substep, in the frame of the child's centre of mass
    and about it.
    """

    def __init__(
        self, name: str, row: WrenchSettings, joint: LinkIndex, client: int, seed: int
    ) -> None:
        self._row = row
        self._joint = joint
        self._client = client
        inertial = bullet.getDynamicsInfo(*joint, client)[3:5]
        self._centre, self._rotation = np.array(inertial[0]), rotation_of(inertial[1])
        bullet.enableJointForceTorqueSensor(*joint, True, client)

        def errors(quantity: str) -> Errors:
            noise, bias = getattr(row.noise, quantity), getattr(row.bias, quantity)
            return Errors(seed, f"wrenches/{name}/{quantity}", noise, bias, 3)

        self._force, self._torque = errors("force"), errors("torque")

    def describe(self) -> Description:
        """Return the joint."""
        return Description(names=[self._row.joint])

    def sense(self, _t_ns: int) -> Wrench:
        """Return the current reading; 0 before the first step."""
        reaction = np.array(bullet.getJointState(*self._joint, self._client)[2])
        force = -self._rotation @ reaction[:3]
        torque = np.cross(self._centre, force) - self._rotation @ reaction[3:]
        return Wrench(
            force=point(self._force.disturb(force)), torque=point(self._torque.disturb(torque))
        )
