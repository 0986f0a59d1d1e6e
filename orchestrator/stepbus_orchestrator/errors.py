"""What can go wrong in a run, and the exit code of each cause.

RunError
└─ RunFailure                          a run ended before its time; `code` is the exit code
   ├─ StartFailed                      a participant did not spawn, join or get ready
   ├─ ParticipantFault                 a participant raised, or broke the protocol
   ├─ ParticipantDied                  a participant's process ended or was killed
   ├─ StepTimeout (TimeoutError)       a participant held a step past its deadline
   ├─ StopTimeout (TimeoutError)       a participant did not end when it was asked to
   ├─ BusFailed (ConnectionError)      the bus could not be opened
   ├─ RecordingFailed (OSError)        the recording could not be written
   └─ Interrupted                      the user ended it with Ctrl-C
"""

from __future__ import annotations

from enum import IntEnum

from stepbus_schemas import RunError


class ExitCode(IntEnum):
    """One exit code per cause (docs/exit-codes.md)."""

    FINISHED = 0
    INTERNAL = 1
    SCENARIO = 2
    START = 3
    FAULT = 4
    DIED = 5
    STEP_TIMEOUT = 6
    BUS = 7
    RECORDING = 8
    STOP_TIMEOUT = 9
    DIFFERENT = 10
    NONCONFORMING = 11
    INTERRUPTED = 130


class RunFailure(RunError):
    """A run ended before its time.

    participant: who is to blame, if anybody. step: the step it was at; −1 before the first.
    """

    code = ExitCode.INTERNAL

    def __init__(self, message: str, *, participant: str | None = None, step: int = -1) -> None:
        super().__init__(message)
        self.participant = participant
        self.step = step


class StartFailed(RunFailure):
    """A participant did not spawn, join or get ready."""

    code = ExitCode.START


class ParticipantFault(RunFailure):
    """A participant raised, or broke the protocol.

    witness: who found it, where that was another one, which has then ended too.
    """

    code = ExitCode.FAULT
    witness: str | None = None


class ParticipantDied(RunFailure):
    """A participant's process ended or was killed."""

    code = ExitCode.DIED


class StepTimeout(RunFailure, TimeoutError):
    """A participant held a step past its deadline."""

    code = ExitCode.STEP_TIMEOUT


class StopTimeout(RunFailure, TimeoutError):
    """A participant did not end when it was asked to."""

    code = ExitCode.STOP_TIMEOUT


class BusFailed(RunFailure, ConnectionError):
    """The bus could not be opened."""

    code = ExitCode.BUS


class RecordingFailed(RunFailure, OSError):
    """The recording could not be written."""

    code = ExitCode.RECORDING


class Interrupted(RunFailure):
    """The user ended the run."""

    code = ExitCode.INTERRUPTED
