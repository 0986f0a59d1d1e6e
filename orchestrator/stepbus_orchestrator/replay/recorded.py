"""The recorded outputs of participants, and how far a recording can be repeated."""

from collections.abc import Iterable, Iterator

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.layout import CHAIN_TOPIC, topic_of
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_schemas import Description


class RecordedOutputs:
    """The outputs of participants, read in the order of their steps."""

    def __init__(self, recording: Recording, specs: Iterable[ParticipantSpec]) -> None:
        self._recorded: dict[str, Iterator[tuple[int, dict[str, bytes]]]] = {}
        for spec in specs:
            topics = [topic_of(spec.name, port) for port in spec.outputs]
            ports = [recording.ports[topic] for topic in topics if topic in recording.ports]
            self._recorded[spec.name] = recording.steps_of(ports)
        self._newest: dict[str, tuple[int, dict[str, bytes]]] = dict.fromkeys(
            self._recorded, (-1, {})
        )

    def take(self, name: str, step: int) -> dict[str, bytes]:
        """Return port → bytes of a step, which must not be below the last step taken."""
        while self._newest[name][0] < step:
            self._newest[name] = next(self._recorded[name], (FAR, {}))
        newest, ports = self._newest[name]
        return ports if newest == step else {}


def recorded_descriptions(recording: Recording) -> dict[str, dict[str, Description]]:
    """Return the participants' descriptions of their outputs."""
    outputs: dict[str, dict[str, Description]] = {}
    for port in recording.ports.values():
        outputs.setdefault(port.participant, {})[port.name] = port.description
    return outputs


PROGRAM = ("participant", "exec", "bridge", "params")
"""The keys of a participant that a replay tests, and that a branch may change."""
_WIRING = ("every", "publishes", "inputs", "outputs")


def rewired(was: Scenario, now: Scenario, names: Iterable[str]) -> list[str]:
    """Return the differing keys of two scenarios that decide who reads what at which step."""
    keys = ("step_ns", "seed")
    changed = [key.removesuffix("_ns") for key in keys if getattr(was, key) != getattr(now, key)]
    for name in names:
        old, new = was.participant(name), now.participant(name)
        changed += [f"{name}.{key}" for key in _WIRING if getattr(old, key) != getattr(new, key)]
    return changed


def check_whole(recording: Recording, scenario: Scenario, names: Iterable[str]) -> None:
    """Raise RecordingFailed for holes, and where participants read what is not recorded whole."""
    for name in names:
        for item in scenario.participant(name).inputs.values():
            output = scenario.participant(item.source).outputs[item.port]
            if output.record_every != 1:
                raise RecordingFailed(
                    f"{recording.path}: {name} reads {item.from_}, which is not fully "
                    f"recorded (`record: {output.record}`), so it cannot be repeated "
                    "from this recording; record a run with `record: all` for that output"
                )
    if holes := recording.holes():
        raise RecordingFailed(
            f"{recording.path} has a hole: {'; '.join(holes)}; record the run again"
        )


def replayable_steps(recording: Recording, scenario: Scenario, name: str) -> int:
    """Return how many steps a participant can be replayed for.

    That is up to the end of the run or, where it failed, of the participant or of its sources.
    """
    spec, end, missing = scenario.participant(name), recorded_end(recording), recording.incomplete
    ahead = spec.every if spec.publishes == "first" else 0
    ends = [
        missing[item.source] + item.delay for item in spec.inputs.values() if item.source in missing
    ]
    if name in missing:
        # What it publishes first is the result of the step before.
        ends.append(missing[name] - ahead)
    elif ahead and not recording.messages_sha256:
        # The recording was cut off, and lacks the result of the last step.
        ends.append((end - 1) // ahead * ahead)
    return max(0, min([end, *ends]))


def recorded_end(recording: Recording) -> int:
    """Return the number of complete steps of the run."""
    rest = (port for topic, port in recording.ports.items() if topic != CHAIN_TOPIC)
    newest = max((port.last_step for port in rest), default=-1)
    chain = recording.ports[CHAIN_TOPIC].last_step if CHAIN_TOPIC in recording else -1
    # The last chain stands at the end of the run; a recording that was cut off has none there.
    return chain if chain >= max(newest, 0) else newest + 1
