"""A recording, read lazily; also one that is cut off anywhere."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from os import PathLike
from pathlib import Path
from typing import Any, Self

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.plugins import Plot, view
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.chains import Holes, messages_sha256
from stepbus_orchestrator.recording.source import Source
from stepbus_participant import suggest
from stepbus_schemas import Description, Message, WiringError

from .port import BATCH_BYTES, Batch, Port, batches, description_of, recorded_types


class UnknownPort(WiringError, KeyError):
    """A recording has no such port; the sentence names the nearest one."""

    __str__ = Exception.__str__


class Recording:
    """A recording: `recording["plant.joint_state"].position` is an array of shape (T, n).

    ports: by topic such as `plant/joint_state`, in recorded order. attachments: the scenario and
    its files, by name. scenario: content of the scenario file; empty if it cannot be read.
    metadata: versions, machine and settings of the run, by name. types: message types, including
    custom types from its schemas.

    path: a recording, or the folder of its run. Opening reads only the index; messages are read on
    demand. A truncated or corrupt file gives everything before the damage. Raises RecordingFailed
    when the file cannot be read, is not an MCAP file, or has invalid channel descriptions.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = layout.recording_file(Path(path))
        self._source = Source(self.path)
        index = self._source.index
        self.attachments: Mapping[str, bytes] = index.attachments
        self.scenario: Mapping[str, Any] = index.scenario
        self.metadata: Mapping[str, Mapping[str, str]] = index.metadata
        self.types = recorded_types(index.schemas.values())
        self._holes: Sequence[str] | None = None
        self.counts: Counter[str] = Counter()
        """Topic → how many messages it has, once `holes` has read them."""
        self.ports: Mapping[str, Port] = self._read_ports()

    @property
    def damage(self) -> str:
        """Return the damage found so far in the file; empty if none.

        A file that is still being written counts as undamaged.
        """
        return "" if self._source.is_live else self._source.damage

    @property
    def cut_short(self) -> str:
        """Return why the recording ends early, such as `is damaged: …`; empty if it is complete."""
        if self._source.is_live:
            return "is still being written"
        return f"is damaged: {self.damage}" if self.damage else ""

    @property
    def last_step(self) -> int:
        """Return the newest step with a message; −1 without any."""
        return max((port.last_step for port in self.ports.values()), default=-1)

    @property
    def incomplete(self) -> Mapping[str, int]:
        """Return participant → first step without its outputs, for a failed run."""
        return self.steps_in(layout.INCOMPLETE_METADATA)

    def steps_in(self, record: str) -> Mapping[str, int]:
        """Return the steps in a metadata record, by their keys."""
        rows = self.metadata.get(record, {})
        return {key: int(text) for key, text in rows.items() if layout.is_step(text)}

    @property
    def last_whole_step(self) -> int:
        """Return the newest step that all participants have reached."""
        return min([self.last_step, *self.incomplete.values()])

    @property
    def messages_sha256(self) -> str:
        """Return the SHA-256 of all messages (P13.3); empty if no chain covers the last step."""
        chain = self.ports.get(layout.CHAIN_TOPIC)
        last = None if chain is None else chain.last
        if last is None or last.step < self.last_step:
            return ""
        return messages_sha256(last.data)

    def __getitem__(self, topic: str) -> Port:
        """Return a port by `participant/port` or `participant.port`.

        Raises UnknownPort, a KeyError, when the recording has none of that name.
        """
        port = self.ports.get(topic) or self.ports.get(topic.replace(".", "/", 1))
        if port is None:
            raise UnknownPort(f"{self.path} has no port {topic!r}{suggest(topic, self.ports)}")
        return port

    def __contains__(self, topic: str) -> bool:
        """Return whether there is such a port."""
        return topic in self.ports or topic.replace(".", "/", 1) in self.ports

    def of_type(self, type_name: str) -> list[Port]:
        """Return the ports of a message type, e.g. `JointState/1`, in recorded order."""
        return [port for port in self.ports.values() if port.type == type_name]

    def messages(self, topic: str) -> Iterator[tuple[int, Message]]:
        """Yield (step, message) of a port, as `recording[topic].messages()`."""
        return self[topic].messages()

    def batches(
        self, ports: Iterable[Port], most_bytes: int = BATCH_BYTES
    ) -> Iterator[dict[str, Batch]]:
        """Yield all messages of some ports in batches: topic → batch, each over the same steps.

        Reads the recording once and holds one batch of about `most_bytes` in memory.
        """
        return batches(self._source, list(ports), most_bytes)

    def steps_of(self, ports: Iterable[Port]) -> Iterator[tuple[int, dict[str, bytes]]]:
        """Yield (step, bytes by the name of the port) of some ports of one participant."""
        names = {number: port.name for port in ports for number in port.channels}
        rows = self._source.rows(frozenset(names))
        for step, group in groupby(rows, itemgetter(1)):
            yield step, {names[row[0]]: row[3] for row in group}

    def holes(self) -> Sequence[str]:
        """Return a text for each gap in the recording; reads all messages.

        The hash chains prove that nothing else is missing, up to the last chain (P13.3).
        """
        if self._holes is None:
            index = self._source.index
            holes = Holes(index.scenario)
            for channel, step, _, data in self._source.rows():
                topic = index.channels[channel].topic
                holes.add(topic, step, data)
                self.counts[topic] += 1
            self._holes = holes.found
        return self._holes

    def flaws(self) -> list[str]:
        """Return a text for each missing part: a truncated end, and gaps."""
        holes = [f"has a hole: {hole}" for hole in self.holes()]
        return [*([self.cut_short] if self.cut_short else []), *holes]

    def __repr__(self) -> str:
        """Return its path and its end."""
        return f"<Recording {self.path}, up to step {self.last_step}>"

    def plot(self, *signals: str) -> Plot:
        """Plot signals, such as `plant.joint_state.position`, for a notebook.

        signals: as in `stepbus plot`; none: the positions of all joints. Raises WiringError for an
        unknown signal, ExtraMissing without matplotlib.
        """
        picture: Plot = view("plot")(self, signals)
        return picture

    def frame(self, *signals: str) -> Any:
        """Return signals, such as `plant.joint_state.position`, as a pandas DataFrame.

        signals: ports, fields or single values; none: all. The index is the simulation time `t`
        [s]; columns have names such as `plant.joint_state.position.joint1`; times without a message
        are NaN, or NA in columns of integers and booleans. `frame.attrs["units"]` has the units.
        Raises UnknownPort or WiringError for an unknown signal, ExtraMissing without pandas.
        """
        return view("frame")(self, signals)

    def _repr_html_(self) -> str:
        """Return a table of its ports, for a notebook."""
        return str(view("recording_html")(self))

    def close(self) -> None:
        """Close the file; data that was read stays valid."""
        self._source.close()

    def __enter__(self) -> Self:
        """Return the recording."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Close the file."""
        self.close()

    def _read_ports(self) -> dict[str, Port]:
        numbers: dict[str, list[int]] = {}
        descriptions: dict[str, Description] = {}
        for number, channel in self._source.index.channels.items():
            topic = channel.topic
            numbers.setdefault(topic, []).append(number)
            try:
                descriptions.setdefault(topic, description_of(channel))
            except ValueError as exc:
                raise RecordingFailed(
                    f"{self.path}: the description of {topic} cannot be read: {exc}"
                ) from exc
        return {
            topic: Port(self._source, channels, descriptions, self.types)
            for topic, channels in numbers.items()
        }
