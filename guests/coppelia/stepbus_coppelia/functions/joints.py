"""Joints: where they are, and how they are driven."""

import math
from typing import Any

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.joints import FORCE, HUGE, POSITION, VELOCITY, Control
from stepbus_plant.joint import Joint

from .table import CONSTANTS, Group, number


class Joints(Group):
    """How joints are read and driven."""

    title = "joints"
    also = {"setJointMaxForce": "setJointForce", "getJointMaxForce": "getJointTargetForce"}

    def _joint(self, handle: int) -> Joint:
        if (joint := self.sim.scene.get(handle).joint) is None:
            raise ApiError("object is not a joint.")
        return joint

    def _control(self, handle: int) -> Control:
        return self.sim.scene.controls[self._joint(handle).name]

    def _state(self, handle: int, values: list[float]) -> float:
        return values[self.sim.scene.joint_index[self._joint(handle).name]]

    def getJointPosition(self, handle: int) -> float:
        """Return the position of a joint [rad or m]; without limits, between -π and π."""
        joint, value = self._joint(handle), self._state(handle, self.sim.scene.position)
        is_cyclic = joint.is_rotary and math.isinf(joint.upper)
        return math.remainder(value, 2.0 * math.pi) if is_cyclic else value

    def getJointVelocity(self, handle: int) -> float:
        """Return the velocity of a joint [rad/s or m/s]."""
        return self._state(handle, self.sim.scene.velocity)

    def getJointForce(self, handle: int) -> float:
        """Return the force that its motor has felt: minus what it has applied [N·m or N]."""
        return -self._state(handle, self.sim.scene.effort)

    def setJointPosition(self, handle: int, position: float) -> int:
        """Put a joint somewhere at once, regardless of forces, but within its limits."""
        joint = self._joint(handle)
        value = self._control(handle).position = joint.within_stops(number(position))
        self.sim.scene.put_joint(joint, value)
        return 1

    def setJointTargetPosition(self, handle: int, position: float, _motion: Any = None) -> int:
        """Set the target of a joint, which its motor then tracks."""
        control = self._control(handle)
        if control.mode != POSITION:
            control.drive(POSITION)
        control.position, control.is_new = number(position), True
        return 1

    def getJointTargetPosition(self, handle: int) -> float:
        """Return the target of a joint."""
        return self._control(handle).position

    def setJointTargetVelocity(self, handle: int, velocity: float, _motion: Any = None) -> int:
        """Set the target velocity of a joint, which its motor tracks with its largest force."""
        control, value = self._control(handle), number(velocity)
        if control.mode == FORCE:
            control.drive(VELOCITY)
        if control.joint.mode == "torque" and 0.0 < abs(value) < HUGE:
            raise ApiError(
                f"joint {control.joint.name} has mode torque in the world file, and cannot track "
                f"{value:g} rad/s; give it mode velocity."
            )
        control.velocity, control.is_new = value, True
        if control.mode == VELOCITY and value:
            control.force = math.copysign(control.force, value)
        return 1

    def getJointTargetVelocity(self, handle: int) -> float:
        """Return the target velocity of a joint."""
        return self._control(handle).velocity

    def setJointTargetForce(self, handle: int, force: float, signed: bool = True) -> None:
        """Set the force of a joint in force mode, otherwise the largest force of its motor."""
        control, value = self._control(handle), number(force)
        if not signed:
            value = math.copysign(max(value, 0.0), control.velocity or 1.0)
            if control.mode == FORCE and control.joint.mode == "torque":
                # As a script means it that has no torque: a largest force, and a huge velocity.
                control.drive(VELOCITY)
        elif control.mode == VELOCITY and value * control.velocity < 0.0:
            control.velocity = -control.velocity
        control.force, control.is_new = value, True

    def setJointForce(self, handle: int, force: float) -> int:
        """Set the largest force of a joint's motor, whose sign is that of its target velocity."""
        self.setJointTargetForce(handle, force, signed=False)
        return 1

    def getJointTargetForce(self, handle: int) -> float:
        """Return the force, or largest force, of a joint's motor."""
        return self._control(handle).force

    def getJointMode(self, handle: int) -> tuple[int, int]:
        """Return `jointmode_dynamic`, or `jointmode_kinematic` for a joint of mode teleport."""
        is_kinematic = self._joint(handle).mode == "teleport"
        return CONSTANTS["jointmode_kinematic" if is_kinematic else "jointmode_dynamic"], 0
