"""Messages that hold a robot still, and whether it is at rest."""

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from stepbus_orchestrator.recording import Descriptions
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

_decode_joints = Decoder(JointState)
_decode_base = Decoder(BaseState)


def motion_at_end(
    scenario: Scenario, descriptions: Descriptions, newest: Mapping[str, Mapping[str, Any]]
) -> str:
    """Return a clause that says what still moves, or that nothing does.

    newest: participant → port → its last message. Without a measured velocity it says only that
    stops were sent.
    """
    moving: list[str] = []
    measured = False
    for spec in scenario.participants:
        for port, output in spec.outputs.items():
            data = newest.get(spec.name, {}).get(port)
            if data is None:
                continue
            if output.type == "JointState/1":
                state = _decode_joints(data)
                measured = measured or state.velocity is not None
                described = descriptions.get(spec.name, {}).get(port, Description())
                moving += _moving_joints(described.names, state)
            elif output.type == "BaseState/1":
                measured = True
                moving += _moving_base(port, _decode_base(data))
    if moving:
        return f"but {' and '.join(moving)}"
    return "and brought to rest" if measured else "and told to stop"


def _moving_joints(names: list[str], state: JointState) -> Iterator[str]:
    velocities = state.velocity or []
    rows = list(zip(names or ["a joint"] * len(velocities), velocities, strict=False))
    fastest = max(rows, key=lambda row: abs(row[1]), default=None)
    if fastest is not None and abs(fastest[1]) > _JOINT_RESTS:
        yield f"{fastest[0]} still moves at {fastest[1]:.3f} rad/s or m/s"


def _moving_base(port: str, state: BaseState) -> Iterator[str]:
    if max(abs(state.vx), abs(state.wz)) > _BASE_RESTS:
        yield f"the base ({port}) still moves at {state.vx:.3f} m/s and {state.wz:.3f} rad/s"
