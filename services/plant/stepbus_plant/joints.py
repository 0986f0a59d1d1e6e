"""The joints of a plant: what their URDFs say, overlaid with what the world says."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from stepbus.settings import nearest
from stepbus_schemas import Description, WiringError
from stepbus_schemas.messages import JointMode

from .physics import ModelJoint, Physics
from .world import Actuation, Body, JointSettings


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A movable joint.

    name: unique in the plant. body, index: PyBullet's numbers. position, velocity: at the start
    [rad, rad/s]. lower, upper [rad], max_velocity [rad/s], effort [N·m]: commands saturate there.
    """

    name: str
    body: int
    index: int
    type: str
    mode: JointMode
    actuation: Actuation
    position: float
    velocity: float
    lower: float
    upper: float
    max_velocity: float
    effort: float
    damping: float
    friction: float

    @property
    def reads_back(self) -> bool:
        """Whether PyBullet tells the torque its motor applied."""
        return not (self.mode == "torque" and self.actuation == "direct")


def load_joints(physics: Physics, bodies: Mapping[str, Body], actuation: Actuation) -> list[Joint]:
    """Load all bodies and return their movable joints, set up and at their start positions.

    A joint is called as in its URDF; where several bodies have a joint of the same name, each of
    these is `body/joint`. actuation: where the world does not say it. Raises WiringError that
    lists all mistakes.
    """
    numbers = {name: physics.load(name, body) for name, body in bodies.items()}
    models = {name: physics.joints(number) for name, number in numbers.items()}
    count = Counter(model.name for rows in models.values() for model in rows)
    joints: list[Joint] = []
    problems: list[str] = []
    for name, body in bodies.items():
        problems += _unknown(name, body, models[name])
        for model in models[name]:
            full_name = f"{name}/{model.name}" if count[model.name] > 1 else model.name
            settings = body.joints.get(model.name, JointSettings()).over(body.joint_defaults)
            joint = _merge(full_name, numbers[name], model, settings, actuation)
            problems += [f"bodies.{name}.joints.{model.name}: {text}" for text in _mistakes(joint)]
            joints.append(joint)
    if problems:
        raise WiringError("\n".join(problems))
    for joint in joints:
        _set_up(physics, joint)
    return joints


def _unknown(name: str, body: Body, models: Sequence[ModelJoint]) -> list[str]:
    known = [model.name for model in models]
    return [
        f"bodies.{name}.joints.{joint}: {body.urdf} has no such movable joint; "
        + nearest(joint, known)
        for joint in body.joints
        if joint not in known
    ]


def _merge(
    name: str, body: int, model: ModelJoint, settings: JointSettings, actuation: Actuation
) -> Joint:
    lower = model.lower if settings.lower is None else settings.lower
    upper = model.upper if settings.upper is None else settings.upper
    nearest_to_zero = max(min(0.0, upper), lower)
    return Joint(
        name=name,
        body=body,
        index=model.index,
        type=model.type,
        mode=settings.mode or "torque",
        actuation=settings.actuation or actuation,
        position=nearest_to_zero if settings.position is None else settings.position,
        velocity=settings.velocity or 0.0,
        lower=lower,
        upper=upper,
        max_velocity=model.velocity if settings.max_velocity is None else settings.max_velocity,
        effort=model.effort if settings.effort is None else settings.effort,
        damping=settings.damping or 0.0,
        friction=settings.friction or 0.0,
    )


def _mistakes(joint: Joint) -> list[str]:
    """Return what the world and the URDF together get wrong."""
    texts = []
    if joint.lower > joint.upper:
        texts.append(f"lower limit {joint.lower} is above upper limit {joint.upper}")
    elif not joint.lower <= joint.position <= joint.upper:
        texts.append(f"position {joint.position} is outside {joint.lower} to {joint.upper}")
    if math.isinf(joint.lower) != math.isinf(joint.upper):
        texts.append("has no limits in its URDF: give both 'lower' and 'upper', or none")
    if joint.friction and joint.reads_back:
        texts.append("friction needs mode torque with direct actuation")
    return texts


def _set_up(physics: Physics, joint: Joint) -> None:
    """Set what PyBullet keeps of a joint; its default motor becomes its Coulomb friction."""
    dynamics = {"jointDamping": joint.damping}
    if math.isfinite(joint.lower):
        dynamics |= {"jointLowerLimit": joint.lower, "jointUpperLimit": joint.upper}
    physics.set_joint(joint.body, joint.index, **dynamics)
    physics.drive_velocities(joint.body, [joint.index], [0.0], [joint.friction])
    physics.place(joint.body, joint.index, joint.position, joint.velocity)


def pick(joints: Sequence[Joint], names: Iterable[str], who: str) -> list[Joint]:
    """Return the joints of these names, in their order.

    who: opens the error sentence. Raises WiringError that lists every unknown or double name.
    """
    wanted = list(names)
    known = {joint.name: joint for joint in joints}
    problems = [
        f"{who}: no joint {name!r}; {nearest(name, known)}" for name in wanted if name not in known
    ]
    problems += [f"{who}: joint {name!r} twice" for name, n in Counter(wanted).items() if n > 1]
    if problems:
        raise WiringError("\n".join(problems))
    return [known[name] for name in wanted]


def describe(joints: Sequence[Joint]) -> Description:
    """Return the description of a port with these joints; no limit is ±inf."""
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
            "mode": [joint.mode for joint in joints],
            "actuation": [joint.actuation for joint in joints],
        },
    )
