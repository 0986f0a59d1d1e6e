"""Faults on purpose: `kill plant at 120`, `freeze controller at 10 for 200ms`, `random 3`."""

import dataclasses
import random
import re
from collections.abc import Iterable, Sequence

from stepbus_participant import format_duration, parse_duration, suggest
from stepbus_participant.parameters import Keys, Place, YamlFile
from stepbus_schemas import WiringError

from .model import FaultSpec, ParticipantSpec, Scenario

MESSAGE_FAULTS = ("drop", "delay", "duplicate", "reorder", "corrupt", "oversize")
PROCESS_FAULTS = ("freeze", "kill", "crash", "slow")
FAULT_TYPES = (*MESSAGE_FAULTS, *PROCESS_FAULTS)
_DEFAULT_NS = {"delay": 50_000_000, "slow": 500_000_000}
_LASTING = ("delay", "freeze", "slow")
_MOST = 1000

_FORM = re.compile(r"(\S+) +(\S+) +at +(\d{1,18})(?: +for +(.+))?")
_RANDOM = re.compile(
    r"random +(\d{1,9})(?: +from +(\d{1,18}))?(?: +to +(\d{1,18}))?(?: +seed +(\d{1,18}))?"
)
_HELP = (
    "write TYPE PARTICIPANT at STEP, e.g. 'kill plant at 120' or 'freeze controller at 10 for "
    "200ms', or 'random N [from STEP] [to STEP] [seed N]'"
)


def add_faults(document: YamlFile, faults: Sequence[str]) -> YamlFile:
    """Return a scenario document with the faults of `--fault` appended to its own."""
    own = document.data.get("faults")
    if not (own is None or isinstance(own, list)):
        return document
    first = len(own or [])
    places: dict[Keys, Place] = {
        ("faults", first + i): Place(file=f"--fault {text}") for i, text in enumerate(faults)
    }
    data = {**document.data, "faults": [*(own or []), *faults]}
    return dataclasses.replace(document, data=data, places={**document.places, **places})


def parse_fault(text: str, scenario: Scenario) -> tuple[FaultSpec, ...]:
    """Return the fault that a text stands for in a scenario, or all that its seed draws.

    Raises WiringError when it means nothing, or can never happen.
    """
    drawn = _RANDOM.fullmatch(" ".join(text.split()))
    if drawn is not None:
        return _draw(drawn, scenario)
    fault = read_fault(text)
    _check(fault, scenario)
    return (fault,)


def read_fault(text: str) -> FaultSpec:
    """Return the fault that a text names, unchecked; raises WiringError for any other text."""
    one = _FORM.fullmatch(" ".join(text.split()))
    if one is None:
        raise WiringError(f"{text!r}: not a fault; {_HELP}")
    return FaultSpec(
        type=one[1], participant=one[2], step=int(one[3]), duration_ns=_duration_ns(one[1], one[4])
    )


def format_fault(fault: FaultSpec) -> str:
    """Return the text of a fault, which `parse_fault` reads back."""
    lasting = "" if fault.duration_ns is None else f" for {format_duration(fault.duration_ns)}"
    return f"{fault.type} {fault.participant} at {fault.step}{lasting}"


def faults_of(faults: Iterable[FaultSpec], types: Sequence[str]) -> list[FaultSpec]:
    """Return the faults of some types, in the order of steps."""
    return sorted((f for f in faults if f.type in types), key=lambda fault: fault.step)


def _duration_ns(fault_type: str, text: str | None) -> int | None:
    if text is None:
        return _DEFAULT_NS.get(fault_type)
    if fault_type in FAULT_TYPES and fault_type not in _LASTING:
        raise WiringError(f"{fault_type} takes no duration; only {', '.join(_LASTING)} take one")
    return parse_duration(text)


def _check(fault: FaultSpec, scenario: Scenario) -> None:
    if fault.type not in FAULT_TYPES:
        raise WiringError(f"unknown fault type {fault.type!r}{suggest(fault.type, FAULT_TYPES)}")
    specs = {spec.name: spec for spec in scenario.participants}
    spec = specs.get(fault.participant)
    if spec is None:
        raise WiringError(
            f"no participant {fault.participant!r}{suggest(fault.participant, specs)}"
        )
    if scenario.steps is not None and fault.step >= scenario.steps:
        raise WiringError(
            f"step {fault.step} is past the end of the run, which has steps 0 to "
            f"{scenario.steps - 1}"
        )
    if fault.type in MESSAGE_FAULTS and fault.step % spec.every:
        before = fault.step - fault.step % spec.every
        raise WiringError(
            f"{spec.name} publishes nothing at step {fault.step}: it fires every "
            f"{spec.every} steps; use {before} or {before + spec.every}"
        )


def _draw(form: re.Match[str], scenario: Scenario) -> tuple[FaultSpec, ...]:
    """Return faults of all types at random, the same for the same seed."""
    count, first = int(form[1]), int(form[2] or 0)
    last = int(form[3]) if form[3] else scenario.steps
    if last is None:
        raise WiringError("a run without duration needs a last step: 'random N to STEP'")
    if scenario.steps is not None and last > scenario.steps:
        raise WiringError(f"step {last} is past the end of the run ({scenario.steps} steps)")
    if not 1 <= count <= _MOST:
        raise WiringError(f"must be 1 to {_MOST} faults, not {count}")
    if first >= last:
        raise WiringError(f"there are no steps from {first} to below {last}")
    generator = random.Random(int(form[4]) if form[4] else scenario.seed)  # noqa: S311
    drawn = [_one(generator, first, last, scenario.participants) for _ in range(count)]
    return tuple(sorted(drawn, key=lambda fault: fault.step))


def _one(
    generator: random.Random, first: int, last: int, participants: Sequence[ParticipantSpec]
) -> FaultSpec:
    fault_type = generator.choice(FAULT_TYPES)
    spec = generator.choice(participants)
    step = generator.randrange(first, last)
    lasts_ns = generator.randrange(10, 200) * 1_000_000
    forever = fault_type == "freeze" and generator.random() < 0.5
    return FaultSpec(
        type=fault_type,
        participant=spec.name,
        step=step - step % spec.every if fault_type in MESSAGE_FAULTS else step,
        duration_ns=lasts_ns if fault_type in _LASTING and not forever else None,
    )
