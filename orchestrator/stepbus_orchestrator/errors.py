"""What can go wrong in a run, and the exit code of each cause.

RunError
└─ RunFailure                          a run failed; `code` is the exit code
   ├─ StartFailed                      a participant did not spawn, join or become ready
   ├─ ParticipantFault                 a participant raised, or broke the protocol
   ├─ ParticipantDied                  a participant's process ended or was killed
   ├─ StepTimeout (TimeoutError)       a participant did not finish a step by its deadline
   ├─ StopTimeout (TimeoutError)       a participant did not exit by its deadline
   ├─ BusFailed (ConnectionError)      the bus could not be opened
   ├─ Diverged                         a participant did not repeat what is recorded of it
   ├─ RecordingFailed (OSError)        a recording could not be written or read
   ├─ Untrusted                        a recording made elsewhere would start programs
   └─ Interrupted                      the user pressed Ctrl-C

WiringError
├─ OutputExists (FileExistsError)      what a call would write is there already
└─ SettingsError
   └─ ScenarioError                    lists every problem of a scenario, one a line
"""

from enum import IntEnum

from stepbus_participant import SettingsError
from stepbus_schemas import RunError, WiringError


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
    UNTRUSTED = 12
    INTERRUPTED = 130


class ScenarioError(SettingsError):
    """A scenario is invalid; `problems` lists every reason, and the text has one per line."""


class OutputExists(WiringError, FileExistsError):
    """The output of a call already exists."""

    __str__ = Exception.__str__


def indented(text: str) -> str:
    """Return foreign text with its further lines indented, so that none passes for our message."""
    return "\n    ".join(text.splitlines())


class RunFailure(RunError):
    """A run failed.

    participant: the participant that caused it, if any. step: step of the failure; −1 before the
    first. code: exit code, if not that of the class. cause: the message without details of this
    machine, such as paths.
    """

    code = ExitCode.INTERNAL

    def __init__(
        self,
        message: str,
        *,
        participant: str | None = None,
        step: int = -1,
        code: int | None = None,
        cause: str = "",
    ) -> None:
        super().__init__(message)
        if code is not None:
            self.code = ExitCode(code)
        self.participant = participant
        self.step = step
        self.cause = cause or message


class StartFailed(RunFailure):
    """A participant did not spawn, join or become ready."""

    code = ExitCode.START


class ParticipantFault(RunFailure):
    """A participant raised, or broke the protocol.

    witness: the participant that detected the fault, if another one did; it has ended too.
    """

    code = ExitCode.FAULT
    witness: str | None = None


class ParticipantDied(RunFailure):
    """A participant's process ended or was killed."""

    code = ExitCode.DIED


class StepTimeout(RunFailure, TimeoutError):
    """A participant did not finish a step by its deadline."""

    code = ExitCode.STEP_TIMEOUT


class StopTimeout(RunFailure, TimeoutError):
    """A participant did not exit by its deadline."""

    code = ExitCode.STOP_TIMEOUT


class BusFailed(RunFailure, ConnectionError):
    """The bus could not be opened."""

    code = ExitCode.BUS


class Diverged(RunFailure):
    """A participant did not reproduce its recorded outputs from its recorded inputs."""

    code = ExitCode.DIFFERENT


class RecordingFailed(RunFailure, OSError):
    """A recording could not be written or read."""

    code = ExitCode.RECORDING


class Untrusted(RunFailure):
    """A recording that was made elsewhere would start programs, and the user has not allowed it."""

    code = ExitCode.UNTRUSTED


class Interrupted(RunFailure):
    """The user ended the run with Ctrl-C."""

    code = ExitCode.INTERRUPTED
