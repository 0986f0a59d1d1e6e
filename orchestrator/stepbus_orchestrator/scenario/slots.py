"""How many slots the content of each bulk output needs (P17.2)."""

from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import file_name


def slot_counts(scenario: Scenario, *, has_feedback: bool = True) -> dict[str, int]:
    """Return each bulk output, `<participant>.<port>`, with its number of slots; none on TCP.

    has_feedback: sources wait for what they read, as in a run.
    """
    return {
        file_name(spec.name, port): _count(
            scenario, spec, port, has_feedback=has_feedback and output.record == "off"
        )
        for spec in scenario.participants
        for port, output in spec.outputs.items()
        if output.bulk and scenario.bus.transport == "unix"
    }


def _count(scenario: Scenario, source: ParticipantSpec, port: str, *, has_feedback: bool) -> int:
    """Return after how many of its own the source may reuse a slot.

    Who publishes step k knows that all have reported their steps up to k − window. A reader has
    taken what was published `delay` before a step it does, once it reports that step, or, where it
    publishes first, the next one. It does every `every`-th. Where the source reads that reader,
    it is not a whole window ahead of it; of the orchestrator, which takes what is recorded, it is.
    """
    window = scenario.window
    needed = [1 if has_feedback else window]
    for spec in scenario.participants:
        for item in spec.inputs.values():
            if (item.source, item.port) == (source.name, port):
                lag = item.delay + spec.every - 1
                lag += spec.every if spec.publishes == "first" else 0
                ahead = _most_ahead(source, spec) if has_feedback else None
                needed.append(lag + (window if ahead is None else min(window, ahead)))
    if len(needed) == 1:
        needed.append(window)
    return -(-max(needed) // source.every)


def _most_ahead(source: ParticipantSpec, reader: ParticipantSpec) -> int | None:
    """Return how far a source gets ahead of a reader whose outputs it reads; None: it reads none.

    It publishes step k with what the reader has published at its newest step up to `delay` before
    k, or, where it publishes first, before its step before k.
    """
    own = source.every if source.publishes == "first" else 0
    delays = [item.delay for item in source.inputs.values() if item.source == reader.name]
    return min(delays) + own if delays else None
