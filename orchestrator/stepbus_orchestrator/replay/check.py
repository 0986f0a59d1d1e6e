"""Writes a new reference recording: the old one with one participant's outputs replaced."""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from stepbus_orchestrator.analysis.divergence import Divergence, PortComparison, PortResult
from stepbus_orchestrator.analysis.tolerance import Tolerance
from stepbus_orchestrator.errors import OutputExists, ParticipantFault, argument
from stepbus_orchestrator.recording import Descriptions, McapFile, Recorder, Recording, layout
from stepbus_orchestrator.recording.layout import topic_of
from stepbus_orchestrator.recording.step_order import StepOrder
from stepbus_orchestrator.replay.prepare import Prepared
from stepbus_orchestrator.replay.recorded import (
    Track,
    counts_from_of,
    recorded_descriptions,
    recorded_versions,
)
from stepbus_orchestrator.run.folder import read_files
from stepbus_orchestrator.run.kernel.failures import at
from stepbus_orchestrator.scenario import ParticipantSpec, Schedule, resolved
from stepbus_participant import irregular
from stepbus_schemas import CallRecord, Description, MessageError, Outputs


@contextlib.contextmanager
def new_reference(
    target: Path | None, old: Recording, prepared: Prepared
) -> Iterator[Recorder | None]:
    """Yield what takes the outputs; the file gets its name at the end, if nothing has failed.

    target: must not exist; None: nothing is written. prepared: what is attached: its scenario, and
    its files of the work tree, or else those of the old recording. Raises RecordingFailed when it
    exists or cannot be written.
    """
    if target is None:
        yield None
        return
    if irregular(target) or target.exists():
        raise OutputExists(
            f"{target} exists already; choose another name with {argument('--update')}"
        )
    part = target.with_name(f".{target.name}.part")
    file = McapFile(part)
    scenario = prepared.scenario
    text = (
        resolved(scenario).encode()
        if prepared.is_changed
        else old.attachments[layout.SCENARIO_ATTACHMENT]
    )
    try:
        contents = _files(old) if prepared.files is None else read_files(prepared.files)
        file.attach(layout.SCENARIO_ATTACHMENT, "application/yaml", text)
        for name, content in contents.items():
            file.attach(layout.file_attachment(name), "application/octet-stream", content)
        for name, versions in old.metadata.items():
            if layout.versions_owner(name) in {None, layout.ORCHESTRATOR}:
                file.add_metadata(name, versions)
        order = [scenario.participant(name) for name in Schedule.of(scenario).order]
        yield Recorder(file, order, scenario.step_ns, types=scenario.types)
        part.replace(target)
    finally:
        file.close()
        part.unlink(missing_ok=True)


def _files(recording: Recording) -> dict[str, bytes]:
    return {
        file: content
        for name, content in recording.attachments.items()
        if (file := layout.attached_file(name)) is not None
    }


class Check:
    """The sink of a replay: compares step by step, in whatever order content arrives.

    end: number of steps that are replayed. reference: also gets all outputs, for a new reference
    recording. Raises ParticipantFault for a message that is not of its port's type.
    """

    def __init__(
        self,
        recording: Recording,
        spec: ParticipantSpec,
        tolerance: Tolerance,
        *,
        step_ns: int,
        reference: Recorder | None,
    ) -> None:
        self.notes: list[str] = []
        self._recording = recording
        self._spec = spec
        self._step_ns = step_ns
        self._reference = reference
        self._ports = {
            port: (
                Track(recording, topic_of(spec.name, port)),
                PortComparison(topic_of(spec.name, port), output.type, tolerance, recording.types),
            )
            for port, output in spec.outputs.items()
        }
        self._step = -spec.every
        self._counts_from = counts_from_of(recording).get(spec.name, 0)
        if self._counts_from:
            self.notes.append(
                f"the recording is a branch: {spec.name} was changed at step {self._counts_from}, "
                "and is compared from there on"
            )
        # It works ahead of the run's end, which it has asked for itself; that is not recorded.
        self._is_over = False
        # Bulk content may come after the outputs of later steps.
        self._order = StepOrder({spec.name: list(spec.outputs)})

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Record where the participant describes its outputs otherwise than recorded."""
        own = descriptions[self._spec.name]
        for port in self._spec.outputs:
            topic = topic_of(self._spec.name, port)
            recorded = self._recording.ports.get(topic)
            if recorded is not None and recorded.description != own.get(port, Description()):
                self.notes.append(f"{topic}: its description (names, units, limits) has changed")
        if self._reference is not None:
            self._reference.open_channels(
                {**recorded_descriptions(self._recording), **descriptions},
                {**recorded_versions(self._recording), **versions},
            )

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Ignore it: a replay compares messages."""

    def add_call(self, call: CallRecord) -> None:
        """Ignore it: it comes from the recording."""

    def offer(self, name: str, outputs: Outputs) -> None:
        """Take the outputs of the next step, and compare those that are complete."""
        if self._is_over:
            return
        step = self._step = outputs.step
        self._order.offer(name, outputs)
        self._compare_complete()
        if self._reference is not None:
            self._reference.offer(name, outputs)
        if outputs.end is not None:
            self._is_over = True
            self.notes.append(f"{name} ended the run after step {step}: {outputs.end}")

    def _compare(self, port: str, step: int, data: bytes | None) -> None:
        track, comparison = self._ports[port]
        if step < self._counts_from:
            return
        if comparison.take(step, track.take(step), data) or data is None:
            return
        try:
            comparison.decode(data)
        except MessageError as exc:
            raise ParticipantFault(
                f"{at(step, self._step_ns)}: {self._spec.name}.{port} is {exc}",
                participant=self._spec.name,
                step=step,
            ) from exc

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Take the content of a bulk port, and compare the steps that it completes."""
        self._order.offer_bulk(name, port, step, content)
        self._compare_complete()
        if self._reference is not None:
            self._reference.offer_bulk(name, port, step, content)

    def _compare_complete(self) -> None:
        for step in self._order.complete_below(self._step + 1):
            self._compare_step(step)

    def _compare_step(self, step: int) -> None:
        for published in self._order.take(step):
            if published.fault is not None:
                raise published.fault
            content = dict(published.content)
            for port in self._ports:
                self._compare(port, step, content.get(port))

    def bulk_complete(self) -> bool:
        """Return whether all announced bulk content has arrived."""
        return self._order.bulk_complete()

    def write_below(self, step: int) -> None:
        """Let the new reference grow."""
        if self._reference is not None:
            self._reference.write_below(step)

    def flush(self) -> None:
        """Nothing: the reference can be made again."""

    def finish(self, closing_step: int, closing: Sequence[str]) -> None:
        """Close the new reference."""
        if self._reference is not None:
            self._reference.finish(closing_step, closing)

    def miss_below(self, step: int) -> None:
        """Count all recorded outputs of steps below `step` that did not come as missing."""
        for incomplete in self._order.steps():
            self._compare_step(incomplete)
        for missed in range(self._step + self._spec.every, step, self._spec.every):
            for port in self._ports:
                self._compare(port, missed, None)

    @property
    def divergence(self) -> Divergence | None:
        """Return the first divergence, in the order of the ports within a step."""
        divergences = (comparison.divergence for _, comparison in self._ports.values())
        return min((item for item in divergences if item), key=lambda item: item.step, default=None)

    def results(self) -> list[PortResult]:
        """Return what has become of each port."""
        return [comparison.result() for _, comparison in self._ports.values()]
