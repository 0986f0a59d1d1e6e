"""Writes, reads and recovers the recording of a run."""

from .mcap_file import McapFile
from .reader import Entry, Port, Recording
from .recorder import Recorder
from .recover import Recovery, recover
from .sink import Descriptions, Sink
from .timing import TimingRecorder

__all__ = [
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
