"""The plant: a simulated world whose joints are sensed and commanded, without any bus."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from stepbus_schemas import Description, JointState, WiringError

from .commander import Commander
from .errors import PhysicsError
from .joints import Joint, describe, load_joints, pick
from .params import Noise, Quantity, Resolution
from .physics import Physics
from .sensing import Sensing
from .world import Actuation, World

NO_NOISE = Noise()
FINE = Resolution()


class Plant:
    """A world in motion: sense, command, advance, and again.

    step_ns: length of a communication step [ns]. seed: of the sensor noise. joints: names of those
    that are sensed and can be commanded, in this order; none: all. actuation: how mode torque is
    carried out, where the world does not say it. Raises WiringError when the world does not fit
    its URDFs or the step.
    """

    def __init__(
        self,
        world: World,
        *,
        step_ns: int,
        seed: int = 0,
        joints: Sequence[str] | None = None,
        actuation: Actuation = "direct",
        sense: Sequence[Quantity] = ("position", "velocity", "effort"),
        noise: Noise = NO_NOISE,
        resolution: Resolution = FINE,
    ) -> None:
        self.t_ns = 0
        self._step_ns = step_ns
        physics_ns = world.physics_ns(step_ns)
        self._substeps = range(step_ns // physics_ns)
        self._sensing = Sensing(sense=sense, noise=noise, resolution=resolution, seed=seed)
        self._commanders: list[Commander] = []
        self._physics = Physics(world, physics_ns)
        try:
            self.joints = _choose(load_joints(self._physics, world.bodies, actuation), joints)
        except BaseException:
            self.close()
            raise
        self._slots = {joint.name: slot for slot, joint in enumerate(self.joints)}
        self._applied = [0.0] * len(self.joints)
        self._direct = [slot for slot, joint in enumerate(self.joints) if not joint.reads_back]
        self._groups = _by_body(self.joints)
        self._order = _order(self.joints, self._groups)
        self._commanded: dict[str, str] = {}

    def describe(self) -> Description:
        """Return names, limits, types and modes of the joints."""
        return describe(self.joints)

    def commander(self, names: Sequence[str] = (), *, port: str = "command") -> Commander:
        """Return what takes the commands for these joints.

        names: in the order of the commands' vectors; none: all, in the plant's order. port: for
        error sentences. Raises WiringError when a name is unknown or another's already.
        """
        joints = pick(self.joints, names, f"input {port!r}") if names else self.joints
        problems = [
            f"input {port!r}: joint {joint.name!r} is commanded by input "
            f"{self._commanded[joint.name]!r} already"
            for joint in joints
            if joint.name in self._commanded
        ]
        if problems:
            raise WiringError("\n".join(problems))
        commander = Commander(
            port=port,
            joints=joints,
            physics=self._physics,
            applied=self._applied,
            slots=[self._slots[joint.name] for joint in joints],
        )
        self._commanded |= dict.fromkeys((joint.name for joint in joints), port)
        self._commanders.append(commander)
        return commander

    def sense(self) -> JointState:
        """Return what the sensors read now; effort is what the motors applied in the last step.

        Raises PhysicsError when the state is not finite any more.
        """
        rows = self._states()
        position = [row[0] for row in rows]
        velocity = [row[1] for row in rows]
        if not math.isfinite(sum(position) + sum(velocity)):
            self._refuse_divergence(position, velocity)
        effort = [row[3] for row in rows]
        for slot in self._direct:
            effort[slot] = self._applied[slot]
        return self._sensing.measure(position, velocity, effort)

    def advance(self) -> None:
        """Carry out the commands during one communication step."""
        commanders = self._commanders
        for _ in self._substeps:
            for commander in commanders:
                commander.drive()
            self._physics.step()
        self.t_ns += self._step_ns

    def close(self) -> None:
        """Give the physics engine back; may be called again."""
        self._physics.close()

    def _states(self) -> Sequence[Any]:
        """Return PyBullet's state of each joint, in the plant's order."""
        if len(self._groups) == 1:
            return self._physics.states(*self._groups[0])
        rows = [row for group in self._groups for row in self._physics.states(*group)]
        return [rows[place] for place in self._order]

    def _refuse_divergence(self, position: list[float], velocity: list[float]) -> None:
        for joint, q, v in zip(self.joints, position, velocity, strict=True):
            if not math.isfinite(q + v):
                raise PhysicsError(
                    f"t = {self.t_ns / 1e9:.3f} s: joint {joint.name!r} is at {q} rad, {v} rad/s: "
                    "the simulation has diverged; check its commands or take a smaller physics_step"
                )


def _choose(joints: Sequence[Joint], names: Sequence[str] | None) -> list[Joint]:
    chosen = list(joints) if names is None else pick(joints, names, "params.joints")
    if not chosen:
        raise WiringError("the plant has no movable joint to sense or command")
    return chosen


def _by_body(joints: Sequence[Joint]) -> list[tuple[int, list[int]]]:
    """Return (body, indices of its joints) for each body, so that each is read in one call."""
    groups: dict[int, list[int]] = {}
    for joint in joints:
        groups.setdefault(joint.body, []).append(joint.index)
    return list(groups.items())


def _order(joints: Sequence[Joint], groups: Sequence[tuple[int, list[int]]]) -> list[int]:
    """Return where the state of each joint stands among the states of all groups."""
    keys = [(body, index) for body, indices in groups for index in indices]
    return [keys.index((joint.body, joint.index)) for joint in joints]
