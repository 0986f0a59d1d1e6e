"""What happens in a world, and when: by its script, or by a call."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import pybullet as bullet

from stepbus_participant import CallError, Method, suggest
from stepbus_plant.camera import Cameras
from stepbus_plant.engine import Physics
from stepbus_plant.joint import Joint
from stepbus_plant.world import Action
from stepbus_schemas import WiringError

# More torque than any motor has, and the share of the error corrected per substep: a wheel at
# 5 rad/s under a base of 80 kg stops within 0.022 rad, and within 0.001 rad after 0.1 s.
_JAM_EFFORT = 1e6
_JAM_GAIN = 0.5


class _Lock(NamedTuple):
    """A jammed joint and its position [rad]."""

    joint: Joint
    position: float


class Script:
    """The actions of a run; each is executed once, in order of time.

    actions: checked by `check_script`. bodies: names of the engine's bodies, in its order.
    has_moved: whether a call has moved a body.
    """

    def __init__(
        self, actions: Sequence[Action], physics: Physics, bodies: Sequence[str], cameras: Cameras
    ) -> None:
        self._physics = physics
        self._bodies = {name: number for number, name in enumerate(bodies)}
        self._joints = {joint.name: joint for joint in physics.joints}
        self._cameras = cameras
        self._pending = sorted(actions, key=lambda action: action.at_ns)
        self._locks: dict[str, _Lock] = {}
        self._events: list[str] = []
        self.has_moved = False

    @property
    def body_names(self) -> list[str]:
        """Return the names of all bodies, in the order of the world."""
        return list(self._bodies)

    def move(
        self, t_ns: int, name: str, position: Sequence[float], rpy: Sequence[float] | None
    ) -> None:
        """Move a body now, as a call asks; t_ns: the time [ns]."""
        self.has_moved = True
        self._events.append(f"at {t_ns / 1e9:.9g} s: {self._move_body(name, position, rpy)}")

    def run(self, t_ns: int) -> None:
        """Execute the actions that are due at a time [ns]."""
        while self._pending and self._pending[0].at_ns <= t_ns:
            text = self._execute(self._pending.pop(0))
            self._events.append(f"at {t_ns / 1e9:.9g} s: {text}")

    @property
    def jammed(self) -> Collection[str]:
        """Return the names of the jammed joints."""
        return self._locks.keys()

    def take_events(self) -> list[str]:
        """Return what has happened since the last call, one sentence each."""
        events, self._events = self._events, []
        return events

    def _execute(self, action: Action) -> str:
        """Execute an action and return what has happened."""
        if action.body is not None and action.position is not None:
            return self._move_body(action.body, action.position, action.orientation_rpy)
        if action.jam is not None:
            return self._jam(self._joints[action.jam])
        off = action.off is not False
        self._cameras.switch(str(action.camera), on=not off)
        return f"camera {action.camera} was switched {'off' if off else 'on'}"

    def _move_body(self, name: str, position: Sequence[float], rpy: Sequence[float] | None) -> str:
        """Move a body, which is then at rest; its joints keep their positions."""
        body, client = self._bodies[name], self._physics.client
        # PyBullet sets the pose of the centre of mass; users give that of the URDF's frame.
        inertial = bullet.getDynamicsInfo(body, -1, client)[3:5]
        if rpy is None:
            centre = bullet.getBasePositionAndOrientation(body, client)
            rotation = bullet.multiplyTransforms(*centre, *bullet.invertTransform(*inertial))[1]
        else:
            rotation = bullet.getQuaternionFromEuler(rpy)
        pose = bullet.multiplyTransforms(position, rotation, *inertial)
        bullet.resetBasePositionAndOrientation(body, *pose, physicsClientId=client)
        # Wake all bodies: a sleeping one that lay on this body would stay in the air.
        for number in self._bodies.values():
            self._physics.wake(number)
        target = ", ".join(f"{value:g}" for value in position)
        angles = "" if rpy is None else f", turned to {', '.join(f'{a:g}' for a in rpy)} rad"
        return f"{name} was put at {target} m{angles}"

    def _jam(self, joint: Joint) -> str:
        """Lock a joint at its current position."""
        if joint.name not in self._locks:
            position = self._physics.read(joint.body, [joint.index])[0][0]
            self._locks[joint.name] = _Lock(joint, position)
        unit = "rad" if joint.is_rotary else "m"
        return f"joint {joint.name} jammed at {self._locks[joint.name].position:.6g} {unit}"

    def before_substep(self) -> None:
        """Hold the jammed joints; call it after the drives, whose motors it overrides."""
        for joint, position in self._locks.values():
            bullet.setJointMotorControl2(
                joint.body,
                joint.index,
                bullet.POSITION_CONTROL,
                targetPosition=position,
                targetVelocity=0.0,
                positionGain=_JAM_GAIN,
                velocityGain=1.0,
                force=_JAM_EFFORT,
                maxVelocity=math.inf,
                physicsClientId=self._physics.client,
            )


def check_script(
    actions: Sequence[Action], physics: Physics, bodies: Sequence[str], cameras: Sequence[str]
) -> None:
    """Raise WiringError that lists every name in a script that is not in the world."""
    known: dict[str, Collection[str]] = {
        "body": bodies,
        "jam": [joint.name for joint in physics.joints],
        "camera": cameras,
    }
    mistakes = [
        f"params.script.{number}.{key}: {_unknown(key, name, names, physics.fixed)}"
        for number, action in enumerate(actions)
        for key, names in known.items()
        if (name := getattr(action, key)) is not None and name not in names
    ]
    if mistakes:
        raise WiringError("\n".join(mistakes))


def _unknown(key: str, name: str, known: Collection[str], fixed: Collection[str]) -> str:
    if key == "jam" and name in fixed:
        return f"joint {name!r} is fixed in its model"
    return f"{'joint' if key == 'jam' else key} {name!r} is unknown{suggest(name, known)}"


class WorldCalls:
    """Answers calls about the bodies of a world. time_ns: returns its time [ns]."""

    def __init__(self, script: Script, time_ns: Callable[[], int]) -> None:
        self._script = script
        self._time_ns = time_ns

    def methods(self) -> Mapping[str, Method]:
        """Return every call by its name."""
        return {
            "body_names": Method(self.names, "names of all bodies"),
            "move_body": Method(
                self.move,
                "NAME X Y Z [YAW]: puts a body, which is then at rest, at a position [m] and "
                "heading [rad]",
                changes=True,
            ),
        }

    def names(self) -> list[str]:
        """Return the names of all bodies, in the order of the world."""
        return self._script.body_names

    def move(self, name: str, x: float, y: float, z: float, yaw: float | None = None) -> None:
        """Put a body somewhere; raises CallError for an unknown body, or what is no number."""
        known = self._script.body_names
        if not isinstance(name, str) or name not in known:
            raise CallError(f"body {name!r} is unknown{suggest(str(name), known)}")
        for value in (x, y, z, *([] if yaw is None else [yaw])):
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not is_number or not math.isfinite(value):
                raise CallError(f"body {name}: {value!r} is no number")
        rpy = None if yaw is None else (0.0, 0.0, float(yaw))
        self._script.move(self._time_ns(), name, (float(x), float(y), float(z)), rpy)
