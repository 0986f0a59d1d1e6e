"""Whether everything stands at the end of a safe stop, by what the plants measured last."""

from collections.abc import Iterator, Mapping
from typing import Any

from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.scenario import Scenario
from stepbus_schemas import BaseState, Decoder, Description, JointState

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
