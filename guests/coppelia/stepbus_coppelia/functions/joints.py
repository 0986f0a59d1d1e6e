"""Joints: where they are, and how they are driven."""

import math
from typing import TYPE_CHECKING, Any

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.joints import FORCE, POSITION, VELOCITY, Control
from stepbus_coppelia.scene import SceneObject

from .table import CONSTANTS, function, number

if TYPE_CHECKING:
    from stepbus_coppelia.session import Session

_GROUP = "joints"


def _joint(sim: "Session", handle: int) -> tuple[SceneObject, Control, int]:
    """Return a joint, how it is driven, and its place in the state."""
    thing = sim.scene.get(handle)
    if thing.joint is None:
        raise ApiError("object is not a joint.")
    name = thing.joint.name
    return thing, sim.controls[name], sim.scene.joint_index[name]


@function(_GROUP)
def get_joint_position(sim: "Session", handle: int) -> float:
    """Return the position of a joint [rad or m]; one without limits is between -π and π."""
    _, control, index = _joint(sim, handle)
    value = sim.scene.position[index]
    is_cyclic = control.joint.is_rotary and math.isinf(control.joint.upper)
    return math.remainder(value, 2.0 * math.pi) if is_cyclic else value


@function(_GROUP)
def get_joint_velocity(sim: "Session", handle: int) -> float:
    """Return the velocity of a joint [rad/s or m/s]."""
    return sim.scene.velocity[_joint(sim, handle)[2]]


@function(_GROUP)
def get_joint_force(sim: "Session", handle: int) -> float:
    """Return the force that a joint's motor has felt: minus what it has applied [N·m or N]."""
    return -sim.scene.effort[_joint(sim, handle)[2]]


@function(_GROUP)
def set_joint_position(sim: "Session", handle: int, position: float) -> int:
    """Put a joint somewhere at once, regardless of forces."""
    _, control, _ = _joint(sim, handle)
    value = number(position)
    if text := control.joint.cannot_teleport(value):
        raise ApiError(text + ".")
    sim.put_joint(control.joint, value)
    control.position = value
    return 1


@function(_GROUP)
def set_joint_target_position(
    sim: "Session", handle: int, position: float, _motion: Any = None
) -> int:
    """Set the target of a joint, which its motor then tracks."""
    _, control, _ = _joint(sim, handle)
    if control.mode != POSITION:
        control.drive(POSITION)
    control.position, control.is_new = number(position), True
    return 1


@function(_GROUP)
def get_joint_target_position(sim: "Session", handle: int) -> float:
    """Return the target of a joint."""
    return _joint(sim, handle)[1].position


@function(_GROUP)
def set_joint_target_velocity(
    sim: "Session", handle: int, velocity: float, _motion: Any = None
) -> int:
    """Set the target velocity of a joint, which its motor tracks with its largest force."""
    _, control, _ = _joint(sim, handle)
    value = number(velocity)
    if control.mode == FORCE:
        control.drive(VELOCITY)
    control.check_velocity(value)
    control.velocity, control.is_new = value, True
    if control.mode == VELOCITY and value:
        control.force = math.copysign(control.force, value)
    return 1


@function(_GROUP)
def get_joint_target_velocity(sim: "Session", handle: int) -> float:
    """Return the target velocity of a joint."""
    return _joint(sim, handle)[1].velocity


@function(_GROUP)
def set_joint_target_force(sim: "Session", handle: int, force: float, signed: bool = True) -> int:
    """Set the force of a joint in force mode, otherwise the largest force of its motor."""
    _, control, _ = _joint(sim, handle)
    value = number(force)
    if not signed:
        value = math.copysign(max(value, 0.0), control.velocity or 1.0)
        if control.mode == FORCE and control.joint.mode == "torque":
            # As a script means it that has no torque: a largest force, and a huge velocity.
            control.drive(VELOCITY)
    elif control.mode == VELOCITY and value * control.velocity < 0.0:
        control.velocity = -control.velocity
    control.force, control.is_new = value, True
    return 1


@function(_GROUP, "setJointMaxForce")
def set_joint_force(sim: "Session", handle: int, force: float) -> int:
    """Set the largest force of a joint's motor, whose sign is that of its target velocity."""
    return set_joint_target_force(sim, handle, force, signed=False)


@function(_GROUP, "getJointMaxForce")
def get_joint_target_force(sim: "Session", handle: int) -> float:
    """Return the force, or largest force, of a joint's motor."""
    return _joint(sim, handle)[1].force


@function(_GROUP)
def get_joint_interval(sim: "Session", handle: int) -> tuple[bool, list[float]]:
    """Return whether a joint turns without limits, and its lower limit and range."""
    joint = _joint(sim, handle)[1].joint
    if math.isinf(joint.upper):
        return True, [-math.pi, 2.0 * math.pi]
    return False, [joint.lower, joint.upper - joint.lower]


@function(_GROUP)
def get_joint_type(sim: "Session", handle: int) -> int:
    """Return `joint_revolute` or `joint_prismatic`."""
    joint = _joint(sim, handle)[1].joint
    return CONSTANTS["joint_revolute" if joint.is_rotary else "joint_prismatic"]


@function(_GROUP)
def get_joint_mode(sim: "Session", handle: int) -> tuple[int, int]:
    """Return `jointmode_dynamic`, or `jointmode_kinematic` for a joint of mode teleport."""
    is_kinematic = _joint(sim, handle)[1].joint.mode == "teleport"
    return CONSTANTS["jointmode_kinematic" if is_kinematic else "jointmode_dynamic"], 0


@function(_GROUP)
def set_joint_mode(sim: "Session", handle: int, _mode: int, _options: int = 0) -> int:
    """Do nothing but check the joint: the world file says what drives it."""
    _joint(sim, handle)
    return 1
