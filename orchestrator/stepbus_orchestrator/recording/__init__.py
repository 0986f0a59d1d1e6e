"""Writes, reads and recovers the recording of a run.

What reads is imported when it is first used: a run only writes, and needs no NumPy.
"""

from typing import TYPE_CHECKING, Any

from stepbus_orchestrator.recording.mcap_file import McapFile, whole_file
from stepbus_orchestrator.recording.recorder import Recorder
from stepbus_orchestrator.recording.sink import Descriptions, Sink

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


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from stepbus_orchestrator.recording import reader  # noqa: PLC0415  (NumPy takes longer to load than the rest)

    return getattr(reader, name)
