"""The movable joints of a world: the URDF's properties, overridden by the world file's."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from stepbus_models import Joint as DescribedJoint
from stepbus_models import Mimic
from stepbus_plant.world import Actuation, JointSettings, OwnMode
from stepbus_schemas import Description, JointCommand, Point


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One movable joint of the world.

    name: unique in the world; `body/joint` if two bodies share it. body, index: the engine's
    numbers. type: revolute, continuous or prismatic. axis: in the frame of its child. lower, upper:
    stops [rad]. effort: torque limit [N·m]. max_velocity: limit of the commanded velocity [rad/s];
    0: none. motor: a joint without a motor swings freely. brake: deceleration in an emergency stop
    [rad/s²]; None: as fast as it can. damping: [N·m·s/rad]. friction: Coulomb friction [N·m].
    start, start_velocity: at t = 0 [rad, rad/s]. mimic: the joint of its body that it follows.
    For prismatic joints read [m] and [N] instead of [rad] and [N·m].
    """

    name: str
    body: int
    index: int
    type: str
    axis: Point
    lower: float
    upper: float
    effort: float
    max_velocity: float
    mode: OwnMode
    motor: bool
    actuation: Actuation
    brake: float | None
    damping: float
    friction: float
    start: float
    start_velocity: float
    mimic: Mimic | None = None

    @property
    def effective_mode(self) -> str:
        """Return its mode, or `passive` if it has no motor."""
        return self.mode if self.motor else "passive"

    @property
    def is_rotary(self) -> bool:
        """Return whether its position is an angle."""
        return self.type != "prismatic"

    @property
    def unit(self) -> str:
        """Return the unit of its position."""
        return "rad" if self.is_rotary else "m"

    @property
    def effort_unit(self) -> str:
        """Return the unit of its effort."""
        return "N·m" if self.is_rotary else "N"

    def within_stops(self, position: float) -> float:
        """Return the nearest position that it can have [rad]."""
        return min(max(position, self.lower), self.upper)

    def cannot_teleport(self, position: float) -> str:
        """Return why it cannot be put at a position [rad], as a sentence; empty: it can."""
        # NaN fails the comparison too.
        if self.lower <= position <= self.upper and not math.isinf(position):
            return ""
        return (
            f"joint {self.name} cannot be teleported to {position:g}; its limits are "
            f"[{self.lower:g}, {self.upper:g}]"
        )

    def without_effect(self, command: JointCommand, index: int) -> Iterator[tuple[str, str]]:
        """Yield cause and sentence of each part of a command that cannot take effect on it.

        index: its own in the vectors of the command.
        """
        value, limits = command.values[index], command.effort_limit
        is_torque = command.mode == "torque"
        if self.mimic is not None:
            yield (
                "mimic",
                f"follows joint {self.mimic.joint!r} (<mimic>); command that joint instead",
            )
        elif not self.motor:
            yield "motor", "has no motor (world file: motor: false); it swings freely"
        elif not is_torque and min(self.effort, limits[index] if limits else math.inf) <= 0.0:
            yield "effort", f"has an effort limit of 0 {self.effort_unit}; nothing moves it"
        elif command.mode == "position":
            if (stop := self.within_stops(value)) != value:
                text = f"target {value:g} {self.unit} is beyond its stop at {stop:g}"
                yield "stop", f"{text}; limited to it"
            velocity = 0.0 if command.velocity is None else command.velocity[index]
            # Tolerate the rounding error of a sender that moves exactly at the limit.
            if 0 < 1.001 * self.max_velocity < abs(velocity):
                text = f"its target moves at {velocity:g} {self.unit}/s, its limit is "
                yield "target velocity", f"{text}{self.max_velocity:g}; it falls behind"
        elif abs(value) > (limit := self.effort if is_torque else self.max_velocity or math.inf):
            unit = self.effort_unit if is_torque else f"{self.unit}/s"
            yield command.mode, f"{value:g} {unit} exceeds its limit of {limit:g}; limited to it"

    def follow(self, leader: Joint, mimic: Mimic) -> Joint:
        """Return the joint as a follower of another one: without a motor, where that takes it."""
        return dataclasses.replace(
            self,
            motor=False,
            start=mimic.multiplier * leader.start + mimic.offset,
            start_velocity=mimic.multiplier * leader.start_velocity,
            mimic=mimic,
        )

    def problems(self) -> Iterator[str]:
        """Yield contradictions between the world file and the URDF."""
        if math.isfinite(self.lower) != math.isfinite(self.upper):
            yield "has no limits in its URDF; give both 'lower' and 'upper', or neither"
        elif self.lower > self.upper:
            yield f"lower {self.lower} is above upper {self.upper}"
        elif self.mimic is None and not self.lower <= self.start <= self.upper:
            limits = f"[{self.lower}, {self.upper}]"
            yield f"start position {self.start} is outside its limits {limits}"
        if self.friction and self.motor and (self.mode, self.actuation) != ("torque", "direct"):
            yield "friction needs mode torque with actuation direct"


def make_joint(
    where: tuple[int, int],
    described: DescribedJoint,
    settings: JointSettings,
    *,
    actuation: Actuation,
    damping: float,
) -> Joint:
    """Return a joint as described, overridden by the settings.

    where: its numbers in the engine. actuation, damping [N·m·s/rad]: where the settings have none.
    """

    def either(*values: float | None) -> float:
        return next((value for value in values if value is not None), 0.0)

    lower = either(settings.lower, described.lower, -math.inf)
    upper = either(settings.upper, described.upper, math.inf)
    return Joint(
        name=described.name,
        body=where[0],
        index=where[1],
        type=described.type,
        axis=described.axis,
        lower=lower,
        upper=upper,
        effort=either(settings.effort, described.effort),
        max_velocity=either(settings.max_velocity, described.velocity),
        mode=settings.mode or "torque",
        motor=settings.motor is not False,
        actuation=settings.actuation or actuation,
        brake=settings.brake,
        damping=either(settings.damping, damping),
        friction=settings.friction or 0.0,
        start=either(settings.position, min(max(0.0, lower), upper)),
        start_velocity=settings.velocity or 0.0,
    )


def describe_joints(joints: Sequence[Joint], details: Mapping[str, list[str]] = {}) -> Description:
    """Return their names, limits, types and modes, and the joints that some follow.

    details: further ones.
    """
    followed = [joint.mimic.joint if joint.mimic is not None else "" for joint in joints]
    return Description(
        names=[joint.name for joint in joints],
        limits={
            "lower": [joint.lower for joint in joints],
            "upper": [joint.upper for joint in joints],
            "velocity": [joint.max_velocity for joint in joints],
            "effort": [joint.effort for joint in joints],
        },
        details={
            "type": [joint.type for joint in joints],
            "mode": [joint.effective_mode for joint in joints],
            **({"mimic": followed} if any(followed) else {}),
            **details,
        },
    )
