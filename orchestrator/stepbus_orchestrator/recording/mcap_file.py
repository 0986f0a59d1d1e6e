"""The MCAP file of a run: MessagePack messages with JSON Schemas."""

import contextlib
import errno
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mcap import records as mcap

from stepbus_orchestrator.errors import RecordingFailed, argument
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.message_writer import MessageWriter
from stepbus_orchestrator.recording.reserved_file import ReservedFile
from stepbus_participant import Disk
from stepbus_schemas import json_schema, reached

_FAILURES = (OSError, MemoryError)
"""What a write that failed raises."""


class McapFile:
    """An MCAP file of MessagePack messages with JSON Schemas, and nothing that differs by run.

    All methods but `close` raise RecordingFailed when the file cannot be written or is closed.
    After the first failed write nothing but the index is appended: a recording has no hole.

    closed: whether the file is complete; nothing can be added to it then.
    """

    def __init__(self, path: Path, disk: Disk = os) -> None:
        self.path = path
        self.closed = False
        self._schemas: dict[str, int] = {}
        self._refusal: RecordingFailed | None = None
        """Why nothing can be added: the first failure, or that the file is closed."""
        self._unreported: RecordingFailed | None = None
        with self._translated():
            self._file = ReservedFile(path, disk)
            self._writer = MessageWriter(self._file, keep_room=self._file.keep_room)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file."""
        attachment = mcap.Attachment(
            create_time=0, log_time=0, name=name, media_type=media_type, data=data
        )
        with self._translated():
            self._writer.add(attachment)

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a metadata record."""
        with self._translated():
            self._writer.add(mcap.Metadata(name, dict(content)))

    def add_channel(
        self,
        topic: str,
        type_name: str,
        metadata: Mapping[str, str],
        schema_of: Callable[[str], Mapping[str, Any]] = json_schema,
    ) -> int:
        """Register a channel and, once, its type's JSON Schema; return the channel's number."""
        with self._translated():
            if type_name not in self._schemas:
                text = json.dumps(schema_of(type_name), sort_keys=True, ensure_ascii=False)
                name, encoding = layout.schema_name(type_name), layout.SCHEMA_ENCODING
                schema = mcap.Schema(id=0, name=name, encoding=encoding, data=text.encode())
                self._schemas[type_name] = self._writer.register(schema)
            channel = mcap.Channel(
                id=0,
                topic=topic,
                message_encoding=layout.MESSAGE_ENCODING,
                metadata=dict(metadata),
                schema_id=self._schemas[type_name],
            )
            return self._writer.register(channel)

    def add(self, channel: int, t_ns: int, data: bytes, sequence: int) -> None:
        """Write one message."""
        self.add_all([(channel, data)], t_ns, sequence)

    def add_all(self, messages: Sequence[tuple[int, bytes]], t_ns: int, sequence: int) -> None:
        """Write messages of one time, (channel, content) each, in their order."""
        if not messages:
            # No participant has published at this step: its time is no part of the chunk.
            return
        # Called for every step: the context manager would take longer than the rest.
        if self._refusal is not None:
            raise self._refusal
        try:
            self._writer.add_messages(messages, t_ns, t_ns, sequence)
        except _FAILURES as exc:
            raise self.refuse(exc) from exc

    def flush(self) -> None:
        """Write all messages, so that the file has them even after a kill; it raises nothing.

        To be called between steps, whose end it marks. The bytes of the closed file stay the same.
        """
        if self._refusal is None:
            try:
                self._writer.write_unfinished()
            except _FAILURES as exc:
                # Of a chunk that was being compressed: whatever comes next is refused.
                self._unreported = self.refuse(exc)

    def close(self, name: str = "", content: Mapping[str, str] | None = None) -> None:
        """Write what is left, a last metadata record and the index; harmless when repeated.

        The metadata record is written only where all messages are.
        On a full disk they go into the room that was set aside. Raises RecordingFailed when they
        cannot be written all the same.
        """
        if self.closed:
            return
        self.closed = True
        if self._refusal is None:
            try:
                self._writer.settle()
            except _FAILURES as exc:
                self._unreported = self.refuse(exc)
        self._file.release()
        try:
            last = None if content is None else mcap.Metadata(name, dict(content))
            if self._refusal is not None:
                self._writer.drop_chunks()
                last = None
            self._writer.finish(last)
        except _FAILURES as exc:
            raise self.refuse(exc) from exc
        finally:
            self._file.close()
            closed = f"the recording {self.path} is closed; nothing can be added to it"
            self._refusal = self._refusal or RecordingFailed(closed)
        if self._unreported is not None:
            raise self._unreported

    def check(self) -> None:
        """Raise RecordingFailed when the closed file is not, byte for byte, what was written."""
        try:
            changed = self._file.changed(self._writer.crc)
        except _FAILURES as exc:
            raise self._failure(exc) from exc
        if changed:
            reached("a recording was changed or removed")
            raise RecordingFailed(
                f"the recording {self.path} {changed}: another process changed it during "
                "the run; run again, and do not change the run's folder until the run "
                "ends"
            )

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        if self._refusal is not None:
            raise self._refusal
        try:
            yield
        except _FAILURES as exc:
            raise self.refuse(exc) from exc

    def refuse(self, exc: OSError | MemoryError) -> RecordingFailed:
        """Return the first failure, which refuses all that comes next."""
        reached("a recording cannot be written")
        self._refusal = self._refusal or self._failure(exc)
        return self._refusal

    def _failure(self, exc: OSError | MemoryError) -> RecordingFailed:
        if isinstance(exc, MemoryError):
            return RecordingFailed(
                f"the recording {self.path} cannot be written: the orchestrator has no memory "
                "left; free some memory or raise its limit (ulimit -v)"
            )
        remedy = (
            "raise the file size limit (ulimit -f)"
            if exc.errno == errno.EFBIG
            else f"free some disk space or choose another folder with {argument('--out')}"
        )
        return RecordingFailed(
            f"the recording {self.path} cannot be written: {exc.strerror or exc}; {remedy}"
        )
