"""Messages that hold a robot still, and whether it is at rest."""

from collections.abc import Mapping
from itertools import repeat
from typing import Any

import msgspec

from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.run.kernel.descriptions import newest_of
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_schemas import (
    SHIPPED,
    BaseCommand,
    BaseState,
    Decoder,
    Description,
    Detections,
    Goal,
    JointCommand,
    JointReference,
    JointState,
    Message,
    Plan,
    Types,
)

MOMENTARY = (
    "ControllerStatus/1",
    "Detections/1",
    "Event/1",
    "GoalStatus/1",
    "Image/1",
    "Imu/1",
    "LaserScan/1",
    "Plan/1",
    "PlanRequest/1",
    "PointCloud/1",
    "Text/1",
)
"""Types that report a moment; to repeat such a message would be a lie."""

_NO_PLANNER = Plan(id=0, cause="planner_failed", text="the planner has failed")
"""What is true of every request from then on."""

_NO_PERCEPTION = Detections(frame="", types=[], position=[], orientation=[], confidence=[])
"""Nothing is detected from then on, in no frame: by that a reader knows that perception failed."""


def safe_message(
    type_name: str,
    description: Description,
    given: Mapping[str, Any] | None,
    last: bytes | None,
    types: Types = SHIPPED,
) -> Message | None:
    """Return the safe message of a port; None where nothing is to be published.

    given: the message of the scenario (`on_fault.safe`), which comes first. last: what the
    participant last published on the port. types: those of the scenario.
    """
    cls = types[type_name]
    if given is not None:
        return msgspec.convert(given, cls)
    if type_name in MOMENTARY:
        return {Plan: _NO_PLANNER, Detections: _NO_PERCEPTION}.get(cls)
    if cls is JointCommand:
        return JointCommand(mode="brake", values=[0.0] * len(description.names))
    if cls is BaseCommand:
        return BaseCommand()
    return _at_rest(Decoder(cls)(last)) if last is not None else None


def _at_rest(last: Message) -> Message:
    """Return what comes to rest after the last message of a port."""
    if isinstance(last, Goal):
        # Ids of goals are the sender's own; the next one ends the goal in progress.
        return Goal(id=last.id + 1, type="stop")
    if isinstance(last, JointReference):
        still = [0.0] * len(last.position)
        return JointReference(position=last.position, velocity=still, acceleration=still)
    return last


_JOINT_RESTS = 0.02
"""Velocity below which a joint stands [rad/s, m/s]."""

_BASE_RESTS = 0.005
"""Velocity below which a base stands [m/s, rad/s]."""


def motion_at_end(
    scenario: Scenario, descriptions: Descriptions, newest: Mapping[str, Mapping[str, Any]]
) -> str:
    """Return a clause that says what still moves, or that nothing does.

    newest: participant → port → its last message. Without a measured velocity it says only that
    stops were sent.
    """
    moving: list[str] = []
    measured = False
    for _, joints, described in newest_of(JointState, scenario, descriptions, newest):
        measured = measured or joints.velocity is not None
        velocities = joints.velocity or []
        rows = list(zip(described.names or repeat("a joint"), velocities, strict=False))
        fastest = max(rows, key=lambda row: abs(row[1]), default=None)
        if fastest is not None and abs(fastest[1]) > _JOINT_RESTS:
            moving.append(f"{fastest[0]} still moves at {fastest[1]:.3f} rad/s or m/s")
    for port, base, _ in newest_of(BaseState, scenario, descriptions, newest):
        measured = True
        if max(abs(base.vx), abs(base.wz)) > _BASE_RESTS:
            moving.append(
                f"the base ({port}) still moves at {base.vx:.3f} m/s and {base.wz:.3f} rad/s"
            )
    if moving:
        return f"but {' and '.join(moving)}"
    return "and the robot came to rest" if measured else "and were commanded to stop"
