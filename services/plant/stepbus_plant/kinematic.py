"""A world without dynamics: joints and bases follow their commands at once, nothing falls."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pybullet as bullet

from stepbus_plant.device import Base
from stepbus_plant.device_registry import Devices
from stepbus_plant.drives import Drive
from stepbus_plant.engine import Physics
from stepbus_plant.gripper import FORCE_WITHOUT_DYNAMICS, Gripper
from stepbus_plant.joint import Joint
from stepbus_plant.poses import LinkIndex
from stepbus_plant.script import Script
from stepbus_schemas import WiringError

NOTICE = "dynamics are off: joints and base follow their commands at once, nothing falls or slips"

_REACH = 0.15
"""How far from a pad the gripper searches for what it closes on [m]."""

_ALONG = 0.7
"""Least cosine between the direction of a pad's motion and that to what is between the pads."""

_RELEASED = 1e-4
"""Wider than what it holds by that, a gripper has released it [m]."""


@dataclass(frozen=True, kw_only=True)
class _Grip:
    """What a gripper holds: link, width there [m], and its pose in the frame of the left finger."""

    thing: LinkIndex
    width: float
    pose: tuple[Any, Any]


class Kinematics:
    """Moves joints, bases and what grippers hold, without forces.

    Raises WiringError for a world that needs forces: with a motor of mode torque.
    """

    def __init__(
        self, physics: Physics, drives: Sequence[Drive], devices: Devices, script: Script
    ) -> None:
        self._physics = physics
        self._client = physics.client
        self._script = script
        self._bases, self._grippers = devices.bases, devices.grippers
        self._sensors = devices.contacts
        self._grips: dict[int, _Grip] = {}
        self._drives = drives
        torque = [joint.name for joint in physics.joints if joint.effective_mode == "torque"]
        if torque:
            names = ", ".join(torque[:3])
            text = f"params.dynamics: off is for modes position and velocity; {names} has torque"
            raise WiringError(text)
        self._bodies = range(bullet.getNumBodies(self._client))

    def advance(self, dt: float) -> None:
        """Advance by a communication step of dt [s]; the drives have their newest targets."""
        states = self._next_states(dt)
        for number, gripper in enumerate(self._grippers):
            self._grasp(number, gripper, states)
        for base in self._bases:
            self._roll(base, states, dt)
        for joint, position, velocity in states.values():
            self._physics.teleport(joint, position, velocity)
        for number, gripper in enumerate(self._grippers):
            self._carry(number, gripper)
        for sensor in self._sensors:
            sensor.press(self._pressed())
        # Contacts and cameras read what the engine keeps for each link.
        bullet.performCollisionDetection(self._client)

    def _next_states(self, dt: float) -> dict[str, tuple[Joint, float, float]]:
        """Return joint → position and velocity at the end of the step."""
        states = {}
        for drive in self._drives:
            indices = [joint.index for joint in drive.joints]
            rows = self._physics.read(drive.joints[0].body, indices)
            for index, (joint, row) in enumerate(zip(drive.joints, rows, strict=True)):
                position, velocity = row[0], 0.0
                if joint.name not in self._script.jammed:
                    position, velocity = drive.followed(index, row[0], dt)
                states[joint.name] = (joint, position, velocity)
        return states

    def _roll(self, base: Base, states: dict[str, tuple[Joint, float, float]], dt: float) -> None:
        """Move a body as its wheels roll, on a circular arc."""
        left, right = (states[joint.name][2] for joint in base.joints)
        vx, wz = base.base_motion(left, right)
        if not (vx or wz):
            return
        body, turn = base.joints[0].body, wz * dt
        chord = vx * dt * (math.sin(turn / 2) / (turn / 2) if turn else 1.0)
        step = (
            (chord * math.cos(turn / 2), chord * math.sin(turn / 2), 0.0),
            bullet.getQuaternionFromEuler((0.0, 0.0, turn)),
        )
        inertial = bullet.getDynamicsInfo(body, -1, self._client)[3:5]
        centre = bullet.getBasePositionAndOrientation(body, self._client)
        frame = bullet.multiplyTransforms(*centre, *bullet.invertTransform(*inertial))
        moved = bullet.multiplyTransforms(*bullet.multiplyTransforms(*frame, *step), *inertial)
        bullet.resetBasePositionAndOrientation(body, *moved, physicsClientId=self._client)

    def _grasp(
        self, number: int, gripper: Gripper, states: dict[str, tuple[Joint, float, float]]
    ) -> None:
        """Stop the fingers at what is between them, and hold it; let go when they open."""
        joints = [states[joint.name][0] for joint in gripper.joints]
        wanted = sum(states[joint.name][1] for joint in joints)
        grip, width = self._grips.get(number), gripper.width()
        if grip is None and wanted < width:
            grip = self._between(gripper, width)
            if grip is not None and wanted <= grip.width:
                self._grips[number] = grip
        if number not in self._grips or grip is None:
            gripper.held_without_forces = None
            return
        if wanted > grip.width + _RELEASED:
            del self._grips[number]
            gripper.held_without_forces = None
            return
        gripper.held_without_forces = grip.thing
        for joint in joints:
            states[joint.name] = (joint, grip.width / 2, 0.0)

    def _between(self, gripper: Gripper, width: float) -> _Grip | None:
        """Return what the pads would hold next, closing from a width [m]."""
        sides = [self._ahead(gripper, finger) for finger in gripper.fingers]
        common = sorted(set(sides[0]) & set(sides[1]))
        if not common:
            return None
        thing = min(common, key=lambda link: sides[0][link] + sides[1][link])
        left, right = sides[0][thing], sides[1][thing]
        # The pads centre what they close on.
        shift = [(right - left) / 2 * part for part in gripper.opening()]
        pose = bullet.getBasePositionAndOrientation(thing[0], self._client)
        centred = [a - b for a, b in zip(pose[0], shift, strict=True)]
        frame = bullet.invertTransform(*self._finger_frame(gripper, (width - left - right) / 2))
        relative = bullet.multiplyTransforms(*frame, centred, pose[1])
        return _Grip(thing=thing, width=max(width - left - right, 0.0), pose=relative)

    def _ahead(self, gripper: Gripper, finger: int) -> dict[LinkIndex, float]:
        """Return link → how far a pad is from it [m], below 0 inside, where it closes on it."""
        body, targets = gripper.joints[0].body, {}
        inwards = gripper.opening() if finger == gripper.fingers[1] else None
        opening = inwards or tuple(-part for part in gripper.opening())
        for other in self._bodies:
            if other == body:
                continue
            for row in bullet.getClosestPoints(
                body, other, _REACH, finger, physicsClientId=self._client
            ):
                to_other = [-part for part in row[7]]
                if sum(a * b for a, b in zip(to_other, opening, strict=True)) > _ALONG:
                    targets[other, row[4]] = row[8]
        return targets

    def _finger_frame(self, gripper: Gripper, position: float | None = None) -> tuple[Any, Any]:
        """Return the pose of the left finger; position: as if it stood there [m]."""
        left = gripper.joints[0]
        state = bullet.getLinkState(
            left.body, left.index, computeForwardKinematics=True, physicsClientId=self._client
        )
        if position is None:
            return state[4], state[5]
        now = self._physics.read(left.body, [left.index])[0][0]
        moved = [a + (position - now) * b for a, b in zip(state[4], gripper.opening(), strict=True)]
        return moved, state[5]

    def _pressed(self) -> dict[tuple[LinkIndex, LinkIndex], float]:
        """Return the forces of pads on what they hold; of nothing else on anything."""
        pressed = {}
        for number, grip in self._grips.items():
            gripper = self._grippers[number]
            for finger in gripper.fingers:
                pressed[(gripper.joints[0].body, finger), grip.thing] = FORCE_WITHOUT_DYNAMICS
        return pressed

    def _carry(self, number: int, gripper: Gripper) -> None:
        grip = self._grips.get(number)
        if grip is None:
            return
        pose = bullet.multiplyTransforms(*self._finger_frame(gripper), *grip.pose)
        bullet.resetBasePositionAndOrientation(grip.thing[0], *pose, physicsClientId=self._client)
