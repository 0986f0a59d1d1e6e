"""The angles that joints were last measured at, for who watches a run."""

from collections.abc import Mapping
from typing import Any

from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.scenario import Scenario
from stepbus_schemas import Decoder, JointState, MessageError

_TYPE = "JointState/1"
_decode = Decoder(JointState)


def measured_angles(
    scenario: Scenario, descriptions: Descriptions, newest: Mapping[str, Mapping[str, Any]]
) -> dict[str, float]:
    """Return joint → its newest angle [rad]; prismatic joints have none.

    descriptions: of all outputs. newest: participant → port → its newest message.
    """
    found: dict[str, float] = {}
    for spec in scenario.participants:
        for port, output in spec.outputs.items():
            raw = newest.get(spec.name, {}).get(port)
            described = descriptions.get(spec.name, {}).get(port)
            if output.type != _TYPE or raw is None or described is None:
                continue
            try:
                position = _decode(bytes(raw)).position
            except MessageError:
                continue
            types = described.details.get("type") or [""] * len(described.names)
            rows = zip(described.names, types, position or (), strict=False)
            found |= {name: angle for name, joint, angle in rows if joint != "prismatic"}
    return found
