"""Calls that query joints and bodies between two steps, or teleport them."""

import math
from collections.abc import Callable, Mapping

from stepbus_participant import CallError, Method, suggest
from stepbus_plant.drives import Motors, PositionMotor
from stepbus_plant.joint import Joint
from stepbus_plant.params import Action
from stepbus_plant.script import Script
from stepbus_schemas import WiringError


class Calls:
    """Answers calls about every movable joint of the world, sensed or not, and every body.

    Without noise. Angles [rad], velocities [rad/s], torques [N·m]; prismatic joints have
    [m, m/s, N]. time_ns: returns the plant's time [ns].
    Each of its functions raises CallError for what is unknown, or no number.
    """

    def __init__(self, motors: Motors, script: Script, time_ns: Callable[[], int]) -> None:
        self._motors, self._physics = motors, motors.physics
        self._script, self._time_ns = script, time_ns

    def methods(self) -> Mapping[str, Method]:
        """Return every call by its name."""
        return {
            "joint_names": Method(
                lambda: list(self._physics.joints), "names of all movable joints"
            ),
            "joint_position": Method(
                lambda name: self._state(name)[0], "NAME: true position of a joint [rad]"
            ),
            "joint_velocity": Method(
                lambda name: self._state(name)[1], "NAME: true velocity of a joint [rad/s]"
            ),
            "joint_target": Method(self.target, "NAME: target of a joint in mode position [rad]"),
            "joint_limits": Method(
                self.limits, "NAME: lower, upper [rad], velocity [rad/s], effort [N·m]"
            ),
            "set_joint_position": Method(
                self.teleport, "NAME RAD: teleports a joint and stops it", changes=True
            ),
            "body_names": Method(lambda: self._physics.bodies, "names of all bodies"),
            "move_body": Method(
                self.move_body,
                "NAME X Y Z [YAW]: moves a body to a position [m] and heading [rad] at once, and "
                "stops it",
                changes=True,
            ),
            "push": Method(
                self.push,
                "LINK FORCE [OVER, MORE]: pushes a link or body with a force such as '[0, 20, 0]' "
                "[N] for 100ms; MORE: torque, point, frame as in the script: '{frame: link}'",
                changes=True,
            ),
        }

    def target(self, name: str) -> float:
        """Return the latest position target of a joint [rad]; CallError if its mode has none."""
        joint = self._joint(name)
        drive, index = self._motors.drive_of[joint.name]
        if not isinstance(drive, PositionMotor):
            raise CallError(f"joint {name} has mode {joint.effective_mode}, which has no target")
        return drive.target(index)

    def limits(self, name: str) -> dict[str, float | None]:
        """Return the limits of a joint; None: unlimited."""
        joint = self._joint(name)
        limits = {
            "lower": joint.lower,
            "upper": joint.upper,
            "velocity": joint.max_velocity or math.inf,
            "effort": joint.effort,
        }
        return {key: value if math.isfinite(value) else None for key, value in limits.items()}

    def teleport(self, name: str, position: float) -> None:
        """Teleport a joint to a position [rad]; a joint of mode position then holds it.

        Raises CallError for a position beyond a stop.
        """
        joint = self._joint(name)
        if not _is_number(position):
            raise CallError(f"joint {name}: {position!r} is not a number")
        if text := joint.cannot_teleport(position):
            raise CallError(text)
        if joint.mimic is not None:
            raise CallError(
                f"joint {name!r} mimics joint {joint.mimic.joint!r}; set the position of "
                f"{joint.mimic.joint!r} instead"
            )
        self._physics.teleport(joint, float(position), 0.0)
        drive, index = self._motors.drive_of[joint.name]
        drive.teleport(index, float(position))

    def move_body(self, name: str, x: float, y: float, z: float, yaw: float | None = None) -> None:
        """Put a body somewhere, at rest [m, rad]; without a yaw, it keeps its orientation."""
        known = self._physics.bodies
        if not isinstance(name, str) or name not in known:
            raise CallError(f"body {name!r} is unknown{suggest(name, known)}")
        for value in (x, y, z, 0.0 if yaw is None else yaw):
            if not _is_number(value) or not math.isfinite(value):
                raise CallError(f"body {name}: {value!r} is not a finite number")
        heading = None if yaw is None else float(yaw)
        self._script.move(self._time_ns(), name, (float(x), float(y), float(z)), heading)

    def push(self, link: str, force: object, over: object = "100ms", more: object = None) -> None:
        """Push a link from now on; more: further keys of `Action`, such as `point`."""
        if not isinstance(more := more or {}, dict) or more.keys() - {"torque", "frame", "point"}:
            raise CallError(f"MORE must be a map of torque, frame and point, not {more!r}")
        try:
            given = {"at": "0s", "push": link, "force": force, "over": over, **more}
            self._script.record(self._time_ns(), self._script.pushes.begin(Action.of(given)))
        except WiringError as exc:
            raise CallError(str(exc)) from exc

    def _state(self, name: str) -> tuple[float, float]:
        return self._physics.state(self._joint(name))

    def _joint(self, name: object) -> Joint:
        joints = self._physics.joints
        if not isinstance(name, str) or name not in joints:
            raise CallError(f"joint {name!r} is unknown{suggest(name, joints)}")
        return joints[name]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
