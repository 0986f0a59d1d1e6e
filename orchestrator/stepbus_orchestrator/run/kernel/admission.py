"""Who may join a run: name, token, protocol version, port types (P4.2)."""

import hashlib
from collections.abc import Iterator, Mapping

from msgspec import structs

from stepbus_orchestrator.scenario.fault_texts import MESSAGE_FAULTS, faults_of
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario, low_latency
from stepbus_schemas import (
    PROTOCOL_VERSION,
    SPOKEN,
    Hello,
    InputConfig,
    OutputConfig,
    Protocols,
    Refusal,
    Types,
    Welcome,
    WiringError,
    offered,
)

from .participants import Participants

_NO_LIMIT = 1 << 30
LOW_LATENCY_BYTES = 60_000
"""Largest message that the low-latency transport carries for certain (P3.7) [bytes]."""


def max_message_bytes(scenario: Scenario) -> int:
    """Return the largest message that the scenario's transport carries [bytes] (P3.7)."""
    return LOW_LATENCY_BYTES if low_latency(scenario) else _NO_LIMIT


def participant_seed(seed: int, name: str) -> int:
    """Return a participant's own seed: 53 bits of SHA-256 over the run's seed and its name."""
    digest = hashlib.sha256(f"{seed}/{name}".encode()).digest()
    return int.from_bytes(digest[:8], "little") >> 11


def welcome_of(scenario: Scenario, spec: ParticipantSpec, token: str) -> Welcome:
    """Return the answer to a participant that may join."""
    specs = {other.name: other for other in scenario.participants}
    return Welcome(
        protocol=PROTOCOL_VERSION,
        name=spec.name,
        token=token,
        step_ns=scenario.step_ns,
        every=spec.every,
        publishes=spec.publishes,
        window=scenario.window,
        batch=_batch(scenario, spec),
        seed=participant_seed(scenario.seed, spec.name),
        inputs={
            port: InputConfig(
                source=item.source,
                port=item.port,
                type=specs[item.source].outputs[item.port].type,
                delay=item.delay,
                every=specs[item.source].every,
                bulk=specs[item.source].outputs[item.port].bulk,
            )
            for port, item in spec.inputs.items()
        },
        outputs={
            port: OutputConfig(type=item.type, bulk=item.bulk)
            for port, item in spec.outputs.items()
        },
        params=dict(spec.params),
        folder=spec.folder or str(scenario.folder.resolve()),
        max_outputs_bytes=max_message_bytes(scenario),
        types=dict(scenario.types.only(_port_types(spec, specs)).declarations),
    )


def batches_of(scenario: Scenario, participants: Participants) -> dict[str, int]:
    """Return which participants may publish several steps in one message, and how many (P7.6).

    They have no input, so that they are ahead of all others by up to a window; all that read from
    them are live programs that can take it.
    """
    readers: dict[str, list[str]] = {}
    for spec in scenario.participants:
        for item in spec.inputs.values():
            readers.setdefault(item.source, []).append(spec.name)
    faulty = {fault.participant for fault in faults_of(scenario.faults, MESSAGE_FAULTS)}
    return {
        spec.name: batch
        for spec in scenario.participants
        if spec.name in readers
        and not spec.inputs
        # Others read every message of these.
        and spec.hold is None
        and spec.name not in faulty
        and not any(output.bulk for output in spec.outputs.values())
        and all(
            name in participants and participants[name].takes_batches for name in readers[spec.name]
        )
        and (batch := _batch(scenario, spec)) > 1
    }


def _batch(scenario: Scenario, spec: ParticipantSpec) -> int:
    # One that fires at every fourth step would fill its batch in four windows.
    return max(1, scenario.batch // spec.every)


def _port_types(spec: ParticipantSpec, specs: Mapping[str, ParticipantSpec]) -> list[str]:
    """Return the types of a participant's ports."""
    sources = [specs[item.source].outputs[item.port] for item in spec.inputs.values()]
    return [output.type for output in (*sources, *spec.outputs.values())]


def receive(hello: Hello, welcomes: Mapping[str, Welcome], token: str) -> Welcome | Refusal:
    """Return the answer to a `Hello`."""
    welcome = welcomes.get(hello.name)
    if hello.token != token:
        return Refusal(reason="the ticket is for another run: its token does not match")
    if welcome is None:
        known = ", ".join(welcomes)
        return Refusal(reason=f"no participant {hello.name!r} in this run; it has {known}")
    program = offered(hello)
    number = program.common(SPOKEN)
    if number is None:
        return Refusal(reason=_no_common(hello.name, program))
    reasons = [
        f"{keys[0][:-1]} {hello.name}.{keys[1]}: {text}" if keys else f"{hello.name}: {text}"
        for keys, text in misfits(hello, welcome)
    ]
    if reasons:
        return Refusal(reason="; ".join(reasons))
    return structs.replace(welcome, protocol=number)


def misfits(hello: Hello, welcome: Welcome) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield where a program does not fit the scenario: the keys of a port, or none, and a text."""
    for side in ("inputs", "outputs"):
        types = {port: item.type for port, item in getattr(welcome, side).items()}
        for port, text in _mismatches(getattr(hello, side), types):
            yield (side, port), text
    yield from (((), text) for text in _differing_types(hello, welcome))


def _no_common(name: str, program: Protocols) -> str:
    """Return why no protocol number fits, and which side to update (P14.1)."""
    update = "stepbus here" if program.lowest > SPOKEN.highest else "the program's client library"
    return (
        f"{name} speaks {program}, and this run speaks {SPOKEN}; update {update} "
        "(docs/compatibility.md)"
    )


def _differing_types(hello: Hello, welcome: Welcome) -> list[str]:
    """Return where the program declares a type differently (P14.5)."""
    try:
        known = Types(hello.types)
    except WiringError as exc:
        return str(exc).splitlines()
    return known.misfits(Types(welcome.types), "the program", "the scenario")


def _mismatches(
    program: Mapping[str, str] | None, scenario: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    """Yield the ports of one side that are not those of the scenario."""
    for port in [] if program is None else dict.fromkeys([*scenario, *program]):
        wanted, given = (side.get(port, "no such port") for side in (program or {}, scenario))
        if wanted != given:
            yield port, f"the program has {wanted}, the scenario {given}"
