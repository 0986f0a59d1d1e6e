"""The ports of a recording: what it says of them, and their messages when they are asked for."""

import contextlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.index import Index
from stepbus_orchestrator.recording.reader.columns import Column, array_of, raw_map
from stepbus_orchestrator.recording.records import Row
from stepbus_orchestrator.recording.source import Entry, Source
from stepbus_orchestrator.scenario.ports import RECORD_ALL
from stepbus_participant import suggest
from stepbus_schemas import (
    ENVELOPE_TYPES,
    MESSAGE_TYPES,
    Decoder,
    Description,
    Message,
    Types,
    WiringError,
    declaration_of,
)

BATCH_BYTES = 1024 * 1024
"""Of messages in a batch; decoded they take about ten times as much."""
_NO_SCHEMA = (ValueError, LookupError, TypeError, AttributeError, RecursionError)
_LOWEST = "lower"


def recorded_types(schemas: Iterable[Schema]) -> Types:
    """Return the types of a recording's schemas.

    One that says no type stays unknown: reading its messages says so.
    """
    types = Types()
    for schema in schemas:
        type_name = layout.type_of_schema(schema.name)
        if type_name in MESSAGE_TYPES or type_name in ENVELOPE_TYPES:
            continue
        with contextlib.suppress(WiringError, *_NO_SCHEMA):
            types |= Types({type_name: declaration_of(type_name, json.loads(schema.data))})
    return types


def description_of(channel: Channel) -> Description:
    """Return the description in a channel's metadata; raises ValueError when it is none."""
    content = json.loads(channel.metadata.get(layout.DESCRIPTION_KEY, "{}"))
    limits = content.get("limits") if isinstance(content, dict) else None
    if isinstance(limits, dict):
        # JSON can only write infinity as null: one in `lower` is −∞, elsewhere +∞.
        for key, row in limits.items():
            if isinstance(row, list):
                absent = float("-inf") if key == _LOWEST else float("inf")
                limits[key] = [absent if item is None else item for item in row]
    return msgspec.convert(content, Description)


class PortInfo:
    """What a recording says of a port before its first message.

    topic: `participant/port`. type: `Name/major`. description: as its participant gave it.
    record: what the recording has of it: `all`, `every 10` (of ten steps of its participant the
    first), or `off`. descriptions: of all ports of the recording, by topic, this one included.
    """

    def __init__(
        self, index: Index, channel: Channel, descriptions: Mapping[str, Description]
    ) -> None:
        self.topic = channel.topic
        self.participant, self.name = layout.split_topic(channel.topic)
        schema = index.schemas.get(channel.schema_id)
        self.type = "" if schema is None else layout.type_of_schema(schema.name)
        self.description = descriptions[channel.topic]
        self.record = channel.metadata.get(layout.RECORD_KEY, RECORD_ALL)
        self._index = index
        self._descriptions = descriptions

    @property
    def names(self) -> Sequence[str]:
        """Return the names that the vectors of the port belong to, in their order.

        Those of a port that is `like` an input are those of its source.
        """
        topic, seen = self.topic, set[str]()
        while topic in self._descriptions and topic not in seen:
            seen.add(topic)
            description = self._descriptions[topic]
            if description.names or description.like is None:
                return description.names
            topic = self._source_of(layout.split_topic(topic)[0], description.like)
        return []

    def _source_of(self, participant: str, name: str) -> str:
        try:
            given = self._index.scenario["participants"][participant]["inputs"][name]
            source = given["from"] if isinstance(given, dict) else given
            return layout.topic_of(*source.split(".", 1))
        except (KeyError, TypeError, AttributeError):
            return ""


class Port(PortInfo):
    """One recorded port: `port.position` is a field of all its messages as one array.

    topic: `participant/port`. type: `Name/major`. description: as its participant gave it.
    channels: its numbers in the file.
    A field that has the name of an attribute is there as `port["names"]`.
    """

    def __init__(
        self,
        source: Source,
        channels: Sequence[int],
        descriptions: Mapping[str, Description],
        types: Types,
    ) -> None:
        super().__init__(source.index, source.index.channels[channels[0]], descriptions)
        self._types = types
        self._source = source
        self.channels = frozenset(channels)
        self._arrays: dict[str, NDArray[Any] | None] = {}
        self._clock: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None

    @property
    def message_class(self) -> type[Message]:
        """Return the class of its messages; raises WiringError for an unknown type."""
        return self._types[self.type]

    @property
    def units(self) -> Mapping[str, str]:
        """Return the unit of each field that differs from its message type's."""
        return self.description.units

    @property
    def steps(self) -> NDArray[np.int64]:
        """Return the step of each message, shape (T,)."""
        return (self._clock or self._read(()))[0]

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """Return the simulation time of each message, shape (T,), [ns]."""
        return (self._clock or self._read(()))[1]

    @property
    def t(self) -> NDArray[np.float64]:
        """Return the simulation time of each message, shape (T,), [s]."""
        seconds: NDArray[np.float64] = self.t_ns * np.float64(1e-9)
        return seconds

    @property
    def last_step(self) -> int:
        """Return the step of the last message; −1 without any. It reads one chunk."""
        last = self.last
        return -1 if last is None else last.step

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.steps)

    def __repr__(self) -> str:
        """Return topic and type."""
        return f"<Port {self.topic}: {self.type}>"

    def entries(self) -> Iterator[Entry]:
        """Yield each message undecoded."""
        for _, step, t_ns, data in self._source.rows(self.channels):
            yield Entry(step=step, t_ns=t_ns, data=data)

    @property
    def last(self) -> Entry | None:
        """Return its last message, undecoded; None without any. It reads one chunk."""
        return self._source.latest(self.channels)

    def latest(self, t_ns: int) -> tuple[int, Message] | None:
        """Return (step, message) of the newest message at a time [ns] or before.

        None without any. It reads one chunk. Raises as `messages`.
        """
        entry = self._source.latest(self.channels, t_ns)
        if entry is None:
            return None
        return entry.step, Decoder(self.message_class)(entry.data)

    def messages(self) -> Iterator[tuple[int, Message]]:
        """Yield (step, message).

        Raises WiringError when this version does not know its type, MessageError for a message
        that is not of it.
        """
        decode = Decoder(self.message_class)
        return ((entry.step, decode(entry.data)) for entry in self.entries())

    def maps(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield (step, plain map) of each message, of any type, as its bytes are.

        msgpack decodes them, a codec apart from the one that wrote them; defaults are left out.
        Raises MessageError for bytes that are no map.
        """
        return ((entry.step, raw_map(entry.data)) for entry in self.entries())

    def __getitem__(self, field: str) -> NDArray[Any]:
        """Return one field of all messages.

        Shape (T,) for numbers, (T, n) for vectors in the order of `names`; an array of objects for
        anything else, and for integers that need more than 64 bits together. Raises WiringError for
        a field that the type does not have, and for vectors that are absent in some messages or
        change their length.
        """
        array = self.arrays(field)[field]
        if array is None:
            raise WiringError(
                f"{self.topic}: {field} is absent in some messages or changes its length; "
                "iterate over messages()"
            )
        return array

    def __getattr__(self, field: str) -> NDArray[Any]:
        """Return one field of all messages, as `port[field]`; raises AttributeError too."""
        if field.startswith("_"):
            raise AttributeError(field)
        try:
            return self[field]
        except WiringError as exc:
            raise AttributeError(str(exc)) from exc

    def __dir__(self) -> list[str]:
        """Return the attributes and the fields."""
        return [*super().__dir__(), *self.message_class.__struct_fields__]

    def arrays(self, *fields: str) -> dict[str, NDArray[Any] | None]:
        """Return several fields in one pass; None for one that has no array."""
        missing = [field for field in fields if field not in self._arrays]
        known = self.message_class.__struct_fields__ if missing else ()
        for field in missing:
            if field not in known:
                raise WiringError(
                    f"{self.topic} ({self.type}) has no field {field!r}{suggest(field, known)}"
                )
        if missing:
            self._read(missing)
        return {field: self._arrays[field] for field in fields}

    def _read(self, fields: Sequence[str]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Read fields of all messages, in pieces; return steps and times."""
        pieces: dict[str, list[Column]] = {field: [] for field in fields}
        steps, t_ns = ([np.empty(0, dtype=np.int64)] for _ in range(2))
        for batch in (batch[self.topic] for batch in batches(self._source, [self], BATCH_BYTES)):
            steps.append(batch.steps)
            t_ns.append(batch.t_ns)
            for field, column in batch.columns(fields).items():
                pieces[field].append(column)
        self._arrays |= {field: array_of(*columns) for field, columns in pieces.items()}
        self._clock = np.concatenate(steps), np.concatenate(t_ns)
        return self._clock


class Batch:
    """The messages of one port in some consecutive steps.

    steps: shape (m,). t_ns, t: simulation time, shape (m,), [ns] and [s].
    """

    def __init__(self, port: Port, rows: Sequence[Row]) -> None:
        self._port = port
        self._data = [row[3] for row in rows]
        self.steps: NDArray[np.int64] = np.array([row[1] for row in rows], dtype=np.int64)
        self.t_ns: NDArray[np.int64] = np.array([row[2] for row in rows], dtype=np.int64)

    @property
    def t(self) -> NDArray[np.float64]:
        """Return the simulation time of each message, shape (m,), [s]."""
        seconds: NDArray[np.float64] = self.t_ns * np.float64(1e-9)
        return seconds

    def messages(self) -> Iterator[Message]:
        """Yield its messages; raises MessageError for one that is not of the port's type."""
        return map(Decoder(self._port.message_class), self._data)

    def columns(self, fields: Sequence[str]) -> dict[str, Column]:
        """Return some fields of its messages, numbers and vectors of floats as arrays."""
        if not fields:
            return {}
        default: Any = msgspec.field
        # To skip the other fields takes a fifth of the time.
        rows = [
            (row.name, row.type, default(default=row.default, default_factory=row.default_factory))
            for row in msgspec.structs.fields(self._port.message_class)
            if row.name in fields
        ]
        cls: Any = msgspec.defstruct("Columns", rows, kw_only=True, gc=False)
        messages = list(map(Decoder(cls, self._port.type), self._data))
        return {name: _column([getattr(message, name) for message in messages]) for name in fields}

    def arrays(self, *fields: str) -> dict[str, NDArray[Any] | None]:
        """Return some fields of its messages, as `Port.arrays` does."""
        return {field: array_of(column) for field, column in self.columns(fields).items()}


def _column(values: list[Any]) -> Column:
    array = array_of(values)
    return values if array is None or array.dtype.kind != "f" else array


def batches(source: Source, ports: Sequence[Port], most_bytes: int) -> Iterator[dict[str, Batch]]:
    """Yield topic → batch in one pass, each batch with whole steps.

    most_bytes: of messages; a batch ends with the step that reaches it.
    """
    topics = {number: port.topic for port in ports for number in port.channels}
    rows: dict[str, list[Row]] = {port.topic: [] for port in ports}
    size, newest = 0, -1
    for row in source.rows(frozenset(topics)):
        if size >= most_bytes and row[1] > newest:
            yield {port.topic: Batch(port, rows[port.topic]) for port in ports}
            rows = {port.topic: [] for port in ports}
            size = 0
        rows[topics[row[0]]].append(row)
        size += len(row[3])
        newest = max(newest, row[1])
    if any(rows.values()):
        yield {port.topic: Batch(port, rows[port.topic]) for port in ports}
