"""Reads recordings lazily: the index at once, the messages of a port when they are asked for."""

from stepbus_orchestrator.recording.reader.columns import BATCH_BYTES, Batch, raw_map

from .port import Port
from .recording import Recording
from .source import Entry
from .tail import Tail, TailPort

__all__ = ["BATCH_BYTES", "Batch", "Entry", "Port", "Recording", "Tail", "TailPort", "raw_map"]
