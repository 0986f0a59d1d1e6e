"""Reads recordings lazily: the index at once, the messages of a port when they are asked for."""

from stepbus_orchestrator.recording.reader.columns import raw_map
from stepbus_orchestrator.recording.source import Entry

from .port import BATCH_BYTES, Batch, Port, PortInfo
from .recording import Recording
from .tail import Tail

__all__ = ["BATCH_BYTES", "Batch", "Entry", "Port", "PortInfo", "Recording", "Tail", "raw_map"]
