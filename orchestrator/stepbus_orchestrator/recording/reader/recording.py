"""A recording, read lazily; also one that is cut off anywhere."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.plugins import Plot, view
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.chains import Holes, messages_sha256
from stepbus_orchestrator.recording.reader.columns import BATCH_BYTES, Batch, batches
from stepbus_orchestrator.recording.reader.descriptions import description_of, recorded_types
from stepbus_participant import suggest
from stepbus_schemas import Description, Message, WiringError

from .port import Port
from .source import Source

_STEP = re.compile(r"[0-9]{1,18}")


class UnknownPort(WiringError, KeyError):
    """A recording has no such port; the sentence names the nearest one."""

    __str__ = Exception.__str__


class Recording:
    """A recording: `recording["plant.joint_state"].position` is an array of shape (T, n).

    ports: by topic such as `plant/joint_state`, in recorded order. attachments: the scenario and
    its files, by name. scenario: what the scenario says; empty where it cannot be read. metadata:
    what the run ran on, by name. types: message types, with those of its own that its schemas say.

    path: of a recording, or the folder of its run. Only the index is read at once; messages are
    read when they are asked for. Of a file that is cut off or corrupt, all before the damage is
    there. Raises RecordingFailed when the file cannot be read, is no MCAP file, or describes its
    channels wrongly.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = layout.recording_file(Path(path))
        self._source = Source(self.path)
        index = self._source.index
        self.attachments: Mapping[str, bytes] = index.attachments
        self.scenario: Mapping[str, Any] = index.scenario
        self.metadata: Mapping[str, Mapping[str, str]] = index.metadata
        self.types = recorded_types(index.schema_texts)
        self._holes: Sequence[str] | None = None
        self.ports: Mapping[str, Port] = self._read_ports()

    @property
    def damage(self) -> str:
        """Return what is wrong with the file, as far as it was read; empty when nothing is.

        Nothing is wrong with one that is being written.
        """
        return "" if self._source.is_live else self._source.damage

    @property
    def cut_short(self) -> str:
        """Return why it ends where it does, such as `is damaged: …`; empty when it is complete."""
        if self._source.is_live:
            return "is still being written"
        return f"is damaged: {self.damage}" if self.damage else ""

    @property
    def last_step(self) -> int:
        """Return the newest step with a message; −1 without any."""
        return max((port.last_step for port in self.ports.values()), default=-1)

    @property
    def incomplete(self) -> Mapping[str, int]:
        """Return participant → first step whose outputs are missing; of a failed run."""
        rows = self.metadata.get(layout.INCOMPLETE_METADATA, {})
        known = ((name, step) for name, step in rows.items() if _STEP.fullmatch(step))
        return {name: int(step) for name, step in known}

    @property
    def last_whole_step(self) -> int:
        """Return the newest step that every participant has reached; others may be ahead of it."""
        return min([self.last_step, *self.incomplete.values()])

    @property
    def messages_sha256(self) -> str:
        """Return the SHA-256 of all messages (P13.3); empty where no chain closes the last step."""
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
        """Yield all messages of some ports in pieces: topic → its batch, of the same steps.

        It reads the recording once, and holds one piece of about `most_bytes` at a time.
        """
        return batches(self._source, list(ports), most_bytes)

    def holes(self) -> Sequence[str]:
        """Return what is missing in its midst, a sentence for each hole; it reads all messages.

        The hash chains prove that nothing else is, up to the last of them (P13.3).
        """
        if self._holes is None:
            index = self._source.index
            holes = Holes(index.scenario)
            for channel, step, _, data in self._source.rows():
                holes.add(index.channels[channel].topic, step, data)
            self._holes = holes.end()
        return self._holes

    def flaws(self) -> list[str]:
        """Return a sentence for all that is missing in it: its end, and holes."""
        holes = [f"has a hole: {hole}" for hole in self.holes()]
        return [*([self.cut_short] if self.cut_short else []), *holes]

    def __repr__(self) -> str:
        """Return its path and its end."""
        return f"<Recording {self.path}, up to step {self.last_step}>"

    def plot(self, *signals: str) -> Plot:
        """Return a picture of signals, such as `plant.joint_state.position`; a notebook shows it.

        signals: as of `stepbus plot`; none: the positions of all joints. Raises WiringError for one
        that is not there, ExtraMissing without matplotlib.
        """
        picture: Plot = view("plot")(self, signals)
        return picture

    def frame(self, *signals: str) -> Any:
        """Return signals, such as `plant.joint_state.position`, as a pandas DataFrame.

        signals: of a port, a field or one value of it; none: all. Its index is the simulation time
        `t` [s], a column is called `plant.joint_state.position.joint1`; what a port has no message
        for is NaN. `frame.attrs["units"]` has the units. Raises UnknownPort or WiringError for a
        signal that is not there, ExtraMissing without pandas.
        """
        return view("frame")(self, signals)

    def _repr_html_(self) -> str:
        """Return a table of its ports, for a notebook."""
        return str(view("recording_html")(self))

    def close(self) -> None:
        """Close the file; what was read stays."""
        self._source.close()

    def __enter__(self) -> Self:
        """Return the recording."""
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
