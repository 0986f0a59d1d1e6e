"""Checks of bulk inputs: content that is late, of another step or run, or of another length."""

from collections.abc import Collection

from stepbus_tools.conformance.check import check
from stepbus_tools.conformance.feeds import Ports
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Kit
from stepbus_tools.conformance.outcome import Skipped

from .faults import blames

_OTHER_RUN = "1234567890abcdef"
_LATE_S = 0.1


def _bulk_inputs(kit: Kit) -> dict[str, set[str]]:
    """Return source → its bulk ports that the participant reads; raises Skipped without any."""
    ports: dict[str, set[str]] = {}
    for item in kit.spec.inputs.values():
        if kit.material.scenario.participant(item.source).outputs[item.port].bulk:
            ports.setdefault(item.source, set()).add(item.port)
    if not ports:
        raise Skipped("it has no bulk inputs")
    return ports


@check("P6.5", "bulk content that comes after its `Outputs` changes nothing", inputs=True)
def bulk_late(kit: Kit) -> str:
    """Send the content of some steps late."""
    bulk = _bulk_inputs(kit)

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.release(step + 1)
            is_late = step in {1, kit.middle}
            harness.feed({k: v for k, v in kit.feed.items() if not (is_late and k in bulk)}, step)
            if is_late:
                _feed_late(harness, kit, bulk, step)
            harness.await_output(step)

    kit.unchanged("with late bulk content", play=play)
    return "waited for the content: the same outputs"


def _feed_late(harness: Harness, kit: Kit, bulk: Collection[str], step: int) -> None:
    """Publish the outputs of the sources with bulk ports, and their content some time after."""
    rows = {source: kit.feed[source][step] for source in bulk if step in kit.feed[source]}
    packed = {source: harness.outputs(source, step, ports) for source, ports in rows.items()}
    for source, (outputs, _) in packed.items():
        harness.publish_bytes(source, outputs)
    harness.idle(_LATE_S)
    for source, (_, content) in packed.items():
        for port, data in content.items():
            harness.publish_content(source, port, step, data)


@check("P8.3", "bulk content of another run, or of another step, changes nothing", inputs=True)
def bulk_noise(kit: Kit) -> str:
    """Send content of another run and of an older step before that of each step."""
    bulk = _bulk_inputs(kit)

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.release(step + 1)
            for source, ports in bulk.items():
                for port in ports:
                    harness.publish_content(source, port, step, b"\xc1", token=_OTHER_RUN)
                    if step > 1:
                        harness.publish_content(source, port, step - 2, b"\x80")
            harness.feed(kit.feed, step)
            harness.await_output(step)

    kit.unchanged("with bulk content of another run and step", play=play)
    return "the same outputs"


@check(
    "P8.3",
    "bulk content of another length than announced is a fault that blames the source",
    inputs=True,
    plain=True,
)
def bulk_length(kit: Kit) -> str:
    """Send one byte more than announced."""
    bulk = _bulk_inputs(kit)

    def spoil(harness: Harness, source: str, step: int, ports: Ports) -> None:
        outputs, content = harness.outputs(source, step, ports)
        for port, data in content.items():
            harness.publish_content(source, port, step, data + b"\x00")
        harness.publish_bytes(source, outputs)

    return "; ".join(blames(kit, source, spoil, ports) for source, ports in bulk.items())
