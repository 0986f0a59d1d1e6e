"""Compares two recordings, port by port."""

from collections.abc import Iterator, Mapping, Sequence
from os import fspath
from typing import TypeVar

import msgspec

from stepbus_orchestrator.analysis.code import FileChange, changes
from stepbus_orchestrator.analysis.divergence import (
    Divergence,
    PortComparison,
    PortResult,
    fields_of,
    in_order,
    port_lines,
)
from stepbus_orchestrator.analysis.tolerance import AnyTolerance, Tolerance, tolerance_of
from stepbus_orchestrator.recording import Entry, Recording
from stepbus_orchestrator.recording.layout import CHAIN_TOPIC, SCENARIO_ATTACHMENT, Source, files_of
from stepbus_orchestrator.scenario.ports import RECORD_ALL
from stepbus_schemas import SHIPPED

T = TypeVar("T")


class Diff(msgspec.Struct, frozen=True, kw_only=True):
    """Result of comparing two recordings.

    equal: whether both have the same ports with the same messages, within the tolerance. ports:
    ordered by the step of their first divergence; equal ones last. divergence: the first
    divergence. only_first, only_second: topics in only one of them. steps: newest step of each; −1
    without a message. notes: other differences: attachments, versions, descriptions, damage. code:
    how scenario and files differ; None: not compared.
    """

    first: str
    second: str
    equal: bool
    divergence: Divergence | None
    ports: Sequence[PortResult]
    only_first: Sequence[str]
    only_second: Sequence[str]
    steps: tuple[int, int]
    notes: Sequence[str]
    code: Sequence[FileChange] | None = None

    def text(self) -> str:
        """Return the differences as text, with the first divergence first."""
        lines = [*self._headline()]
        for port in self.ports:
            lines += port_lines(port, "first", "second", self.divergence)
        code = [line for change in self.code or () for line in change.lines()]
        return "\n".join([*lines, *self.notes, *code])

    def _headline(self) -> Iterator[str]:
        count = sum(port.equal + port.within for port in self.ports)
        if self.equal:
            yield f"equal: {count} messages on {len(self.ports)} ports"
        elif self.divergence is not None:
            yield f"first divergence: {self.divergence.text()}"
        if self.code is not None:
            places = ", ".join(change.place for change in self.code)
            yield f"changed code: {places or 'none'}"
        if self.steps[0] != self.steps[1]:
            ends = (f"ends at step {n}" if n >= 0 else "has no message" for n in self.steps)
            yield "the first {}, the second {}".format(*ends)
        for side, topics in (("first", self.only_first), ("second", self.only_second)):
            if topics:
                yield f"only in the {side}: {', '.join(topics)}"


def diff(
    first: Source,
    second: Source,
    tolerance: AnyTolerance = None,
    *,
    is_part: bool = False,
    code: bool = False,
) -> Diff:
    """Compare the messages of two recordings, which may differ in length or be truncated.

    first: a recording, or the folder of its run. second: a recording, or the folder of its run.
    tolerance: tolerances by port, such as `controller/command`; default: byte-identical. is_part:
    the first lacks messages: ignore everything after its end and in its gaps. code: compare their
    scenarios and files too, line by line.

    Raises RecordingFailed when one cannot be read, WiringError when the tolerance names a port or
    field that neither recording has.
    """
    one, other = Recording(first), Recording(second)
    tolerance = tolerance_of(tolerance)
    known = {
        topic: fields_of(port.type, r.types)
        for r in (one, other)
        for topic, port in r.ports.items()
    }
    tolerance.check(known)
    # Their chains sum up what the messages say, and differ wherever they do.
    topics = [topic for topic in one.ports if topic in other.ports and topic != CHAIN_TOPIC]
    # The last step may be incomplete, and nothing is known after a hole.
    reach = (-1 if one.holes() else one.last_step) if is_part else None
    ports = in_order([_compare(topic, one, other, tolerance, reach) for topic in topics])
    only_first, only_second = _missing(one, other), _missing(other, one)
    if is_part and one.last_step < 0:
        only_second = []
    divergence = ports[0].divergence if ports else None
    return Diff(
        first=fspath(first),
        second=fspath(second),
        equal=not (divergence or only_first or only_second),
        divergence=divergence,
        ports=ports,
        only_first=only_first,
        only_second=only_second,
        steps=(one.last_step, other.last_step),
        notes=list(_notes(one, other, topics)),
        code=changes(_sources(one), _sources(other)) if code else None,
    )


def _sources(recording: Recording) -> dict[str, bytes]:
    """Return the resolved scenario and its files, by name."""
    names = (SCENARIO_ATTACHMENT,) if SCENARIO_ATTACHMENT in recording.attachments else ()
    scenario = {name: recording.attachments[name] for name in names}
    return {**files_of(recording.attachments), **scenario}


def _missing(one: Recording, other: Recording) -> list[str]:
    return [topic for topic in one.ports if topic not in other.ports and topic != CHAIN_TOPIC]


def _compare(
    topic: str, one: Recording, other: Recording, tolerance: Tolerance, reach: int | None
) -> PortResult:
    # Types that differ are compared as plain MessagePack.
    types = SHIPPED if _misfits(topic, one, other) else one.types
    port = one.ports[topic]
    comparison = PortComparison(topic, port.type, tolerance, types, names=port.names)
    are_alike = port.record == other.ports[topic].record
    for step, first, second in merged(one[topic].entries(), other[topic].entries()):
        is_in_both = first is not None and second is not None
        if is_in_both or (are_alike and (first is not None or reach is None or step < reach)):
            comparison.take(step, first, second)
    return comparison.result()


def _misfits(topic: str, one: Recording, other: Recording) -> list[str]:
    """Return where a port's type is declared differently."""
    types = one.types.only([one.ports[topic].type])
    return types.misfits(other.types, "the first", "the second")


def merged(
    first: Iterator[Entry], second: Iterator[Entry]
) -> Iterator[tuple[int, bytes | None, bytes | None]]:
    """Yield (step, data of the first, data of the second), None where one has no message."""
    one, other = next(first, None), next(second, None)
    while one is not None or other is not None:
        step = min(entry.step for entry in (one, other) if entry is not None)
        left = right = None
        if one is not None and one.step == step:
            left, one = one.data, next(first, None)
        if other is not None and other.step == step:
            right, other = other.data, next(second, None)
        yield step, left, right


def _notes(one: Recording, other: Recording, topics: Sequence[str]) -> Iterator[str]:
    for recording in (one, other):
        yield from (f"{recording.path} {flaw}" for flaw in recording.flaws())
    for topic in topics:
        a, b = one.ports[topic], other.ports[topic]
        if a.type != b.type:
            yield f"{topic}: the first is {a.type}, the second {b.type}"
        yield from (f"{topic}: {text.partition(';')[0]}" for text in _misfits(topic, one, other))
        if a.record != RECORD_ALL or b.record != RECORD_ALL:
            how = f"{a.record} in the first, {b.record} in the second"
            yield f"{topic}: compared only at the steps that both recordings contain ({how})"
        if a.description != b.description:
            yield f"{topic}: the descriptions differ (names, units or limits)"
    yield from _contents("attachment", one.attachments, other.attachments)
    yield from _contents("metadata", one.metadata, other.metadata)


def _contents(what: str, one: Mapping[str, T], other: Mapping[str, T]) -> Iterator[str]:
    for name in dict.fromkeys((*one, *other)):
        if name not in other or name not in one:
            yield f"{what} {name} is only in the {'first' if name in one else 'second'}"
        elif one[name] != other[name]:
            yield f"{what} {name} differs"
