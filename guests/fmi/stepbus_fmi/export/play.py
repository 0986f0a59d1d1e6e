"""What an exported FMU executes: one participant, or all of a scenario in one process."""

import contextlib
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.run.episode import Episode
from stepbus_orchestrator.run.kernel.admission import welcome_of
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_participant import (
    Config,
    Input,
    OutputPorts,
    Participant,
    Step,
    StepsOver,
    import_participant,
    names_of,
)
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import Description, Message, RunError, due_step, encode

Messages = Mapping[tuple[str, str], Message]
"""Participant and port → message."""


class One:
    """One participant; its class is created, described, started and stepped as in a run.

    described: its inputs. outputs: the newest messages.
    """

    def __init__(self, scenario: Scenario, name: str, described: Mapping[str, Description]) -> None:
        spec = scenario.participant(name)
        config = Config.from_welcome(welcome_of(scenario, spec, ""), scenario.types)
        self.config, self.outputs = config, dict[tuple[str, str], Message]()
        with contextlib.chdir(scenario.folder):
            self.participant = import_participant(spec.participant, scenario.folder)(config)
            own = dict(self.participant.describe())
            self.participant.start({port: described[port] for port in config.inputs})
        # The importer sets what is due: a message is as old as it makes it.
        self._inputs = {
            port: Input(port, msgspec.structs.replace(row, delay=0), config.types)
            for port, row in config.inputs.items()
        }
        self._ports = OutputPorts(config.outputs, config.types, decodes_all=True)
        self._ports.set_names(names_of(own, described))
        self._step = Step(self._inputs, config.step_ns)
        self._is_first = config.publishes == "first"
        self.publish(0)

    def publish(self, index: int) -> None:
        """Publish the outputs of a step, of a participant that does so before its inputs."""
        if self._is_first and index % self.config.every == 0:
            self._step.index = index
            self._take(self.participant.output(self._step))

    def step(self, index: int, messages: Messages) -> str | None:
        """Work on a step, up to what is published at the next; return why the run should end."""
        every = self.config.every
        if index % every == 0:
            self._step.index = index
            for port, item in self._inputs.items():
                row = self.config.inputs[port]
                due = due_step(index, row.delay, row.every)
                is_new = due >= 0 and due != due_step(index - every, row.delay, row.every)
                message = messages.get((self.config.name, port))
                if is_new and message is not None:
                    item.pending.append((index, encode(message)))
                item.settle(index)
            try:
                published = self.participant.update(self._step)
            except StepsOver:
                return "it takes no further step"
            if self._is_first and published:
                raise RunError("update returned messages, with `publishes: first`")
            self._take(published)
        self.publish(index + 1)
        return self._step.end_reason

    def _take(self, messages: Mapping[str, Message] | None) -> None:
        for port, message in (messages or {}).items():
            self._ports.encode(self._step.index, port, message)
            self.outputs[self.config.name, port] = message

    def save(self) -> tuple[bytes | None, dict[str, bytes | None]]:
        """Return its state, and the messages that its inputs hold."""
        values = {port: item.value for port, item in self._inputs.items()}
        held = {port: None if v is None else encode(v) for port, v in values.items()}
        return self.participant.save(), held

    def restore(self, state: bytes, held: Mapping[str, bytes | None]) -> None:
        """Go on from a state; once."""
        self.participant.restore(state)
        for port, item in self._inputs.items():
            item.restore(held[port], ())

    def close(self) -> None:
        """Close the participant."""
        self.participant.close()


class Played(Participant):
    """The participant in whose place the importer is; without outputs, it only reads."""

    def __init__(
        self, config: Config, answer: Callable[[Step], Any], described: Mapping[str, Description]
    ) -> None:
        super().__init__(config)
        self._answer = answer
        self.described = described

    def describe(self) -> Mapping[str, Description]:
        """Return what the participant in this place says."""
        return self.described

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return what the importer answers."""
        messages: Mapping[str, Message] = self._answer(step)
        return messages


class All:
    """All participants of a scenario in this process, as `Episode` has them.

    name: the one in whose place the importer is; empty: one more, which only reads. described: its
    outputs. seen: participant and port of each output that the FMU has. outputs: the newest
    messages; of those that need the importer's message of the same step, the step before's.
    """

    def __init__(
        self,
        scenario: Scenario,
        name: str,
        described: Mapping[str, Description],
        seen: set[tuple[str, str]],
    ) -> None:
        content = parse_yaml("scenario", resolved(scenario))
        rows, late = content["participants"], _late(scenario, name)
        self._name = name or next(n for n in ("fmu", "importer", "listener") if n not in rows)
        self._seen = {f"i{number}": key for number, key in enumerate(sorted(seen))}
        before = rows.get(name, {})
        rows[self._name] = {
            "participant": f"{__name__}:{Played.__name__}",
            "inputs": {
                port: {"from": ".".join(key), "delay": int(key[0] in late)}
                for port, key in self._seen.items()
            },
            **{key: before[key] for key in ("every", "outputs") if key in before},
        }
        self._every = before.get("every", 1)
        self._answer: dict[str, Message] = {}
        self._folder = TemporaryDirectory(prefix="fmu-stepbus-", ignore_cleanup_errors=True)
        self._episode = Episode(
            load(content, folder=scenario.folder),
            self._name,
            lambda config, answer: Played(config, answer, described),
            Path(self._folder.name, "run"),
            is_recorded=False,
        )
        self.outputs = self._read(self._episode.start())

    def _read(self, step: Step) -> Messages:
        messages = {key: step.get(port) for port, key in self._seen.items()}
        return {key: message for key, message in messages.items() if message is not None}

    def step(self, index: int, messages: Messages) -> str | None:
        """Work on a step, up to what is published at the next; return why the run has ended."""
        if index % self._every == 0:
            self._answer = {port: message for (_, port), message in messages.items()}
        if (index + 1) % self._every == 0:
            try:
                self.outputs = self._read(self._episode.advance(self._answer))
            except RunFailure:
                # It raises again, unless a participant has asked for the end.
                return self._episode.end("").reason
        return None

    def close(self) -> None:
        """End the run."""
        self._episode.abandon()
        self._folder.cleanup()


def _late(scenario: Scenario, name: str) -> set[str]:
    """Return the participants whose outputs of a step need that of `name`, itself included."""
    late = {name}
    for _ in scenario.participants:
        late |= {
            spec.name
            for spec in scenario.participants
            if spec.publishes != "first"
            and any(i.source in late and i.delay == 0 for i in spec.inputs.values())
        }
    return late
