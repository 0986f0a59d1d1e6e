"""How many slots the content of each bulk output needs (P17.2)."""

from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import file_name


def slot_counts(scenario: Scenario) -> dict[str, int]:
    """Return each bulk output, `<participant>.<port>`, with its number of slots; none on TCP."""
    return {
        file_name(spec.name, port): _count(scenario, spec, port)
        for spec in scenario.participants
        for port, output in spec.outputs.items()
        if output.bulk and scenario.bus.transport == "unix"
    }


def _count(scenario: Scenario, source: ParticipantSpec, port: str) -> int:
    """Return after how many of its own the source may reuse a slot.

    Who publishes step k knows that all have reported their steps up to k − window. A reader has
    taken what was published `delay` before a step it does, once it reports that step, or, where it
    publishes first, the next one. It does every `every`-th.
    """
    behind = [
        item.delay + spec.every - 1 + (spec.every if spec.publishes == "first" else 0)
        for spec in scenario.participants
        for item in spec.inputs.values()
        if (item.source, item.port) == (source.name, port)
    ]
    return -(-(scenario.window + max(behind, default=0)) // source.every)
