"""Carries out a script: what happens to the world in a run."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import NamedTuple

import pybullet as bullet

from stepbus_participant.settings import nearest
from stepbus_schemas import WiringError

from .devices.camera import Cameras
from .physics.engine import Physics
from .physics.joint import Joint
from .world.actions import Action

# More than any motor has, and how much of an error a substep takes back. A wheel at 5 rad/s under
# a base of 80 kg then stops within 0.022 rad and is back within 0.001 rad after 0.1 s.
_JAM_EFFORT = 1e6
_JAM_GAIN = 0.5


class _Lock(NamedTuple):
    """A jammed joint and the position it has [rad]."""

    joint: Joint
    position: float


class Script:
    """The actions of a run, each carried out once, in the order of their times.

    actions: `check_script` has found nothing wrong with them. bodies: names of the engine's bodies,
    in its order.
    """

    def __init__(
        self, actions: Sequence[Action], physics: Physics, bodies: Sequence[str], cameras: Cameras
    ) -> None:
        self._physics = physics
        self._bodies = {name: number for number, name in enumerate(bodies)}
        self._joints = {joint.name: joint for joint in physics.joints}
        self._cameras = cameras
        self._waiting = sorted(actions, key=lambda action: action.at_ns)
        self._locks: dict[str, _Lock] = {}
        self._news: list[str] = []

    def play(self, t_ns: int) -> None:
        """Carry out what is due at a time [ns]."""
        while self._waiting and self._waiting[0].at_ns <= t_ns:
            text = self._carry_out(self._waiting.pop(0))
            self._news.append(f"at {t_ns / 1e9:.9g} s: {text}")

    def take(self) -> list[str]:
        """Return what has happened since the last call, a sentence each."""
        news, self._news = self._news, []
        return news

    def _carry_out(self, action: Action) -> str:
        """Carry out an action and return what has happened."""
        if action.body is not None and action.position is not None:
            return self._put(action.body, action.position, action.orientation_rpy)
        if action.jam is not None:
            return self._jam(self._joints[action.jam])
        off = action.off is not False
        self._cameras.switch(str(action.camera), on=not off)
        return f"camera {action.camera} was switched {'off' if off else 'on'}"

    def _put(self, name: str, position: Sequence[float], rpy: Sequence[float] | None) -> str:
        """Have a body stand still somewhere else; its joints stay as they are."""
        body, client = self._bodies[name], self._physics.client
        # PyBullet puts the centre of mass, and at rest; the frame of the URDF is what people mean.
        inertial = bullet.getDynamicsInfo(body, -1, client)[3:5]
        if rpy is None:
            centre = bullet.getBasePositionAndOrientation(body, client)
            turned = bullet.multiplyTransforms(*centre, *bullet.invertTransform(*inertial))[1]
        else:
            turned = bullet.getQuaternionFromEuler(rpy)
        pose = bullet.multiplyTransforms(position, turned, *inertial)
        bullet.resetBasePositionAndOrientation(body, *pose, physicsClientId=client)
        # All of them: what lay on this body and sleeps would stay in the air.
        for number in self._bodies.values():
            self._physics.wake(number)
        where = ", ".join(f"{value:g}" for value in position)
        angles = "" if rpy is None else f", turned to {', '.join(f'{a:g}' for a in rpy)} rad"
        return f"{name} was put at {where} m{angles}"

    def _jam(self, joint: Joint) -> str:
        """Hold a joint where it is from now on."""
        if joint.name not in self._locks:
            position = self._physics.read(joint.body, [joint.index])[0][0]
            self._locks[joint.name] = _Lock(joint, position)
        unit = "rad" if joint.is_rotary else "m"
        return f"joint {joint.name} jammed at {self._locks[joint.name].position:.6g} {unit}"

    def before_substep(self) -> None:
        """Hold the jammed joints; to be called after the drives, whose motors this overrules."""
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
    """Raise WiringError that lists every name in a script that the world does not have."""
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
    kind = "joint" if key == "jam" else key
    if key == "jam" and name in fixed:
        return f"joint {name!r} is fixed in its model"
    return f"{kind} {name!r} is unknown; {nearest(name, known)}"
