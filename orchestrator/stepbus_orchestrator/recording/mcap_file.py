"""The MCAP file of a run: MessagePack messages with JSON Schemas."""

import contextlib
import errno
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, IndexType

from stepbus_orchestrator.errors import RecordingFailed, argument
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.recording.message_writer import MessageWriter
from stepbus_orchestrator.recording.reserved_file import ReservedFile
from stepbus_participant import Disk
from stepbus_schemas import json_schema


class McapFile:
    """An MCAP file of MessagePack messages with JSON Schemas, and nothing that differs by run.

    All methods but `close` raise RecordingFailed when the file cannot be written or is closed.
    After the first failed write nothing but the index is appended: a recording has no hole.
    """

    def __init__(self, path: Path, disk: Disk = os) -> None:
        self.path = path
        self._schemas: dict[str, int] = {}
        self._closed = False
        self._failed: RecordingFailed | None = None
        with self._translated():
            self._file = ReservedFile(path, disk)
            sink: Any = self._file
            self._writer: Any = MessageWriter(
                sink,
                chunk_size=layout.CHUNK_BYTES,
                compression=CompressionType.ZSTD,
                index_types=IndexType.ALL,
            )
            self._writer.keep_room = self._file.keep_room
            self._writer.start(profile=layout.PROFILE, library=layout.LIBRARY)

    @property
    def closed(self) -> bool:
        """Return whether the file is complete; nothing can be added to it then."""
        return self._closed

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file."""
        with self._open():
            self._writer.add_attachment(
                create_time=0, log_time=0, name=name, media_type=media_type, data=data
            )

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a metadata record."""
        with self._open():
            self._writer.add_metadata(name, dict(content))

    def add_channel(
        self,
        topic: str,
        type_name: str,
        metadata: Mapping[str, str],
        schema_of: Callable[[str], Mapping[str, Any]] = json_schema,
    ) -> int:
        """Register a channel and, once, its type's JSON Schema; return the channel's number."""
        with self._open():
            if type_name not in self._schemas:
                schema = json.dumps(schema_of(type_name), sort_keys=True, ensure_ascii=False)
                self._schemas[type_name] = self._writer.register_schema(
                    layout.schema_name(type_name), layout.SCHEMA_ENCODING, schema.encode()
                )
            channel: int = self._writer.register_channel(
                topic, layout.MESSAGE_ENCODING, self._schemas[type_name], dict(metadata)
            )
        return channel

    def add(self, channel: int, t_ns: int, data: bytes, sequence: int) -> None:
        """Write one message."""
        self.add_all([(channel, data)], t_ns, sequence)

    def add_all(self, messages: Sequence[tuple[int, bytes]], t_ns: int, sequence: int) -> None:
        """Write messages of one time, (channel, content) each, in their order."""
        if not messages:
            # Nobody has published at this step: its time is no part of the chunk.
            return
        # Called for every step: the context manager would take longer than the rest.
        if self._closed or self._failed is not None:
            raise self._refusal()
        try:
            self._writer.add_messages(messages, t_ns, t_ns, sequence)
        except OSError as exc:
            raise self._failure(exc) from exc

    def flush(self) -> None:
        """Let the file have all messages even if this process is killed; it raises nothing.

        To be called between steps, whose end it marks. The bytes of the closed file stay the same.
        """
        if not self._closed and self._failed is None:
            self._writer.write_unfinished()

    def close(self) -> None:
        """Write what is left and the index; harmless when repeated.

        On a full disk they go into the room that was set aside. Raises RecordingFailed when they
        cannot be written all the same.
        """
        if self._closed:
            return
        self._closed = True
        self._file.release()
        try:
            with self._translated():
                if self._failed is not None:
                    self._writer.drop_chunk()
                self._writer.finish()
        finally:
            self._file.close()

    def check(self) -> None:
        """Raise RecordingFailed when the closed file is not, byte for byte, what was written."""
        with self._translated():
            changed = self._file.changed()
        if changed:
            raise RecordingFailed(
                f"the recording {self.path} {changed}: somebody changed it while the run wrote it; "
                "run again, and leave the run's folder alone until it ends"
            )

    @contextlib.contextmanager
    def _open(self) -> Iterator[None]:
        if self._closed or self._failed is not None:
            raise self._refusal()
        with self._translated():
            yield

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        try:
            yield
        except OSError as exc:
            raise self._failure(exc) from exc

    def _refusal(self) -> RecordingFailed:
        return self._failed or RecordingFailed(
            f"the recording {self.path} is closed; nothing can be added to it"
        )

    def _failure(self, exc: OSError) -> RecordingFailed:
        """Return the failure, which is the first one from then on."""
        remedy = (
            "raise the limit of a file's size (ulimit -f)"
            if exc.errno == errno.EFBIG
            else f"free some disk space or choose another folder with {argument('--out')}"
        )
        self._failed = self._failed or RecordingFailed(
            f"the recording {self.path} cannot be written: {exc.strerror or exc}; {remedy}"
        )
        return self._failed
