"""Writes, reads and recovers the recording of a run.

What reads is imported when it is first used: a run only writes, and needs no NumPy.
"""

from typing import TYPE_CHECKING

from stepbus_orchestrator.recording.mcap_file import McapFile, whole_file
from stepbus_orchestrator.recording.recorder import Recorder
from stepbus_orchestrator.recording.sink import Descriptions, Sink
from stepbus_participant import imported_later

from .checkpoints import Checkpoints, CheckpointWriter, SavedState
from .recover import Recovery, recover
from .timing import TimingRecorder

if TYPE_CHECKING:
    from .reader import BATCH_BYTES, Batch, Entry, Port, PortInfo, Recording, Tail, raw_map

__all__ = [
    "BATCH_BYTES",
    "Batch",
    "CheckpointWriter",
    "Checkpoints",
    "Descriptions",
    "Entry",
    "McapFile",
    "Port",
    "PortInfo",
    "Recorder",
    "Recording",
    "Recovery",
    "SavedState",
    "Sink",
    "Tail",
    "TimingRecorder",
    "raw_map",
    "recover",
    "whole_file",
]


_LATER = ("BATCH_BYTES", "Batch", "Entry", "Port", "PortInfo", "Recording", "Tail", "raw_map")

__getattr__ = imported_later(__name__, dict.fromkeys(_LATER, "reader"))
