"""Checks of slots: bulk content in files that the participants share."""

from stepbus_tools.conformance.feeds import Ports
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Kit, check
from stepbus_tools.conformance.material import Setup
from stepbus_tools.conformance.outcome import Failed, Skipped

from .endings import blames
from .noise import bulk_inputs

_SETUP = Setup(has_slots=True)


@check("P17.3", "bulk content in slots changes nothing", plain=True)
def _slots(kit: Kit) -> str:
    if not any(output.bulk for output in kit.spec.outputs.values()):
        bulk_inputs(kit)
    transcript = kit.play(setup=_SETUP)
    named = transcript.readies[-1].slots
    if not named:
        raise Skipped("its Ready names no slots: its bulk content travels in messages")
    kit.same(transcript, "with bulk content in slots")
    own = {port for port in kit.spec.outputs if f"{kit.spec.name}.{port}" in named}
    for step, outputs in transcript.outputs.items():
        if in_messages := own & outputs.bulk.keys() - outputs.slots.keys():
            raise Failed(f"step {step}: it has slots for {min(in_messages)}, and uses none")
    return f"{', '.join(named)}: the same outputs"


def _slot_inputs(kit: Kit) -> dict[str, set[str]]:
    """Return source → its ports that the participant reads from slots."""
    bulk = bulk_inputs(kit)
    with kit.running(setup=_SETUP) as harness:
        named = harness.transcript.readies[-1].slots
    used = {s: {p for p in ports if f"{s}.{p}" in named} for s, ports in bulk.items()}
    if not any(used.values()):
        raise Skipped("its Ready names none of its bulk inputs")
    return {source: ports for source, ports in used.items() if ports}


@check(
    "P17.4",
    "it reports a fault of the source if a slot does not hold the announced step",
    inputs=True,
    plain=True,
)
def _slot_stamp(kit: Kit) -> str:
    def spoil(harness: Harness, source: str, step: int, ports: Ports) -> None:
        harness.publish(source, step, ports, late=1)

    rows = _slot_inputs(kit).items()
    return "; ".join(blames(kit, source, spoil, ports, _SETUP) for source, ports in rows)
