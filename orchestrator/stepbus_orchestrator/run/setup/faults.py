"""The faults that a participant injects into its own messages."""

from stepbus_orchestrator.scenario import MESSAGE_FAULTS, Scenario
from stepbus_participant import MessageFault


def message_faults(scenario: Scenario, name: str) -> list[MessageFault]:
    """Return the faults on the messages of one participant."""
    return [
        MessageFault(type=fault.type, step=fault.step, duration_s=(fault.duration_ns or 0) * 1e-9)
        for fault in scenario.faults
        if fault.participant == name and fault.type in MESSAGE_FAULTS
    ]
