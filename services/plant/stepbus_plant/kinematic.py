"""A world without dynamics: joints and bases follow their commands at once, nothing falls."""

import math
from dataclasses import dataclass

from stepbus_plant.base import Base
from stepbus_plant.devices import Devices
from stepbus_plant.drives import Motors
from stepbus_plant.engine import BASE, Link
from stepbus_plant.geometry import Pose, quaternion
from stepbus_plant.gripper import FORCE_WITHOUT_DYNAMICS, Gripper
from stepbus_plant.joint import Joint
from stepbus_plant.script import Script

NOTICE = "dynamics are off: joints and base follow their commands instantly, nothing falls or slips"

_REACH = 0.15
"""How far from a pad the gripper searches for what it closes on [m]."""

_ALONG = 0.7
"""Least cosine between the direction of a pad's motion and that to what is between the pads."""

_RELEASED = 1e-4
"""Wider than what it holds by that, a gripper has released it [m]."""

_States = dict[str, tuple[Joint, float, float]]
"""Joint → position and velocity at the end of the step."""


@dataclass
class _Grip:
    """What a gripper holds, the width there [m], and its pose in the frame of the left finger."""

    thing: Link
    width: float
    pose: Pose | None = None


class Kinematics:
    """Moves joints, bases and what grippers hold, without forces."""

    def __init__(self, motors: Motors, devices: Devices, script: Script) -> None:
        self._physics = motors.physics
        self._engine = motors.physics.engine
        self._script = script
        self._devices = devices
        self._grips: dict[str, _Grip] = {}
        self._drives = motors.drives

    def advance(self, dt: float) -> None:
        """Advance by a communication step of dt [s]; the drives have their newest targets."""
        states = self._next_states(dt)
        grippers = self._devices.grippers
        for name, gripper in grippers.items():
            self._grasp(name, gripper, states)
        for base in self._devices.bases.values():
            self._roll(base, states, dt)
        for joint, position, velocity in states.values():
            self._physics.teleport(joint, position, velocity)
        pressed: dict[tuple[Link, Link], float] = {}
        for name, grip in self._grips.items():
            fingers = grippers[name].fingers
            geometry, frame = self._engine.geometry, self._engine.frame(fingers[0])
            if grip.pose is None:
                centre = self._engine.centre(grip.thing[0])
                grip.pose = geometry.compose(geometry.inverse(frame), centre)
            self._engine.put_centre(grip.thing[0], geometry.compose(frame, grip.pose))
            pressed |= {(finger, grip.thing): FORCE_WITHOUT_DYNAMICS for finger in fingers}
        for sensor in self._devices.contacts.values():
            sensor.press(pressed, dt)
        # Contacts and cameras read what the engine keeps for each link.
        self._engine.update_shapes()

    def _next_states(self, dt: float) -> _States:
        states = {}
        for drive in self._drives:
            indices = [joint.index for joint in drive.joints]
            rows = self._engine.read(drive.joints[0].body, indices)
            for index, (joint, (now, *_)) in enumerate(zip(drive.joints, rows, strict=True)):
                is_jammed = joint.name in self._script.jammed
                position, velocity = (now, 0.0) if is_jammed else drive.followed(index, now, dt)
                states[joint.name] = (joint, position, velocity)
        return states

    def _roll(self, base: Base, states: _States, dt: float) -> None:
        """Move a body as its wheels roll, on a circular arc."""
        left, right = (states[joint.name][2] for joint in base.joints)
        vx, wz = base.base_motion(left, right)
        if not (vx or wz):
            return
        body, turn = base.joints[0].body, wz * dt
        chord = vx * dt * (math.sin(turn / 2) / (turn / 2) if turn else 1.0)
        step = (chord * math.cos(turn / 2), chord * math.sin(turn / 2), 0.0)
        frame = self._engine.frame((body, BASE))
        self._engine.put(
            body, self._engine.geometry.compose(frame, (step, quaternion((0.0, 0.0, turn))))
        )

    def _grasp(self, name: str, gripper: Gripper, states: _States) -> None:
        """Stop the fingers at what is between them, and hold it; let go when they open."""
        wanted = sum(states[joint.name][1] for joint in gripper.joints)
        grip, width = self._grips.pop(name, None), gripper.width()
        if grip is None and wanted < width:
            grip = self._between(gripper, width)
        gripper.held_without_forces = None
        if grip is not None and wanted <= grip.width + _RELEASED:
            self._grips[name] = grip
            gripper.held_without_forces = grip.thing
            for joint in gripper.joints:
                states[joint.name] = (joint, grip.width / 2, 0.0)

    def _between(self, gripper: Gripper, width: float) -> _Grip | None:
        """Return what the pads would hold next, closing from a width [m]."""
        opening = gripper.opening()
        left, right = (
            self._ahead(finger, [sign * part for part in opening])
            for finger, sign in zip(gripper.fingers, (-1, 1), strict=True)
        )
        common = sorted(set(left) & set(right))
        if not common:
            return None
        thing = min(common, key=lambda link: left[link] + right[link])
        return _Grip(thing, max(width - left[thing] - right[thing], 0.0))

    def _ahead(self, finger: Link, inwards: list[float]) -> dict[Link, float]:
        """Return link → how far a pad is from it [m], below 0 inside, where it closes on it."""
        targets = {}
        for point in self._engine.closest(finger, _REACH):
            to_other = (-part for part in point.normal)
            if sum(a * b for a, b in zip(to_other, inwards, strict=True)) > _ALONG:
                targets[point.other] = point.distance
        return targets
