"""Writes, reads and recovers the recording of a run."""

from .mcap.file import McapFile
from .reader import BATCH_BYTES, Batch, Entry, Port, Recording
from .recorder import Recorder
from .recover import Recovery, recover
from .sink import Descriptions, Sink
from .timing import TimingRecorder

__all__ = [
    "BATCH_BYTES",
    "Batch",
    "Descriptions",
    "Entry",
    "McapFile",
    "Port",
    "Recorder",
    "Recording",
    "Recovery",
    "Sink",
    "TimingRecorder",
    "recover",
]
