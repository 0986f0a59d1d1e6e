"""The result of a run, result.json: how it ended, with which files and versions, and where."""

import functools
import hashlib
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Self

import msgspec

from stepbus_orchestrator.errors import ExitCode, RunFailure
from stepbus_orchestrator.plugins import view
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.reports import Lateness, Warned
from stepbus_participant import Disk, installed_version, read_file, write_file
from stepbus_participant.parameters import is_name
from stepbus_schemas import UNDECODABLE

if TYPE_CHECKING:
    from stepbus_orchestrator.recording import Recording

RESULT_FILE = "result.json"


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """How a run ended, and where its files are.

    outcome: `finished` or `failed`. exit_code: see docs/exit-codes.md. reason: why it ended, in one
    sentence. cause: the same, without details of this machine, such as paths. participant, at_step:
    the participant that failed, and the step. steps: number of complete steps. wall_s: from the
    first trigger to the end [s]. start_s: from the call to the first trigger [s]. real_time_factor:
    simulated over wall time. sha256: hash of run.mcap. messages_sha256: hash of its messages alone,
    independent of versions, files and processor names. unauthenticated: number of messages without
    the run's token, which were ignored. drops: messages that each participant dropped. faults:
    injected faults. warning_count: warnings and errors that participants reported. warnings: the
    first fifty of each output. file, overrides: scenario file and overrides, on this machine.
    real_time: lateness of the steps, for a run in real time.
    """

    scenario: str
    outcome: str
    exit_code: int
    reason: str
    participant: str | None
    at_step: int
    steps: int
    step_ns: int
    seed: int
    window: int
    transport: str
    start_s: float
    wall_s: float
    real_time_factor: float
    sha256: str
    folder: str
    messages_sha256: str = ""
    cause: str = ""
    unauthenticated: int = 0
    drops: Mapping[str, int] = {}
    faults: Sequence[str] = ()
    warning_count: int = 0
    warnings: Sequence[Warned] = ()
    versions: Mapping[str, str] = {}
    file: str = ""
    overrides: Sequence[str] = ()
    real_time: Lateness | None = None

    @property
    def recording(self) -> Path:
        """Return the path of run.mcap."""
        return Path(self.folder) / layout.RUN_FILE

    def __post_init__(self) -> None:
        """Check the exit code; raises ValueError for one that no run has."""
        ExitCode(self.exit_code)

    def __fspath__(self) -> str:
        """Return the path of run.mcap, so that a result stands wherever a recording does."""
        return str(self.recording)

    @property
    def simulated_s(self) -> float:
        """Return the simulated time [s]."""
        return self.steps * self.step_ns * 1e-9

    @property
    def metrics(self) -> dict[str, float]:
        """Return the metrics of the run by name, as in a sweep: `rmse`, `rmse.joint1`, `energy`, ….

        `metrics.units` has their units. Metrics without data are omitted. Reads the recording;
        raises RecordingFailed when it cannot be read.
        """
        measured: dict[str, float] = view("metrics")(self)
        return measured

    def check(self) -> Self:
        """Return the result if the run finished; raises RunFailure if it failed."""
        if self.exit_code:
            raise RunFailure(
                self.reason,
                participant=self.participant,
                step=self.at_step,
                code=ExitCode(self.exit_code),
                cause=self.cause,
            )
        return self

    def __repr__(self) -> str:
        """Return outcome, steps and folder, in a line."""
        why = f" ({self.reason})" if self.exit_code else ""
        return (
            f"<Result {self.scenario}: {self.outcome} after {self.steps} steps{why}, {self.folder}>"
        )

    def _repr_html_(self) -> str:
        """Return outcome, reason and figures, for a notebook."""
        return str(view("result_html")(self))

    def hashes(self) -> str:
        """Return the hash of the messages, if there is one, and that of the file, a line each."""
        messages = f"messages  {self.messages_sha256}\n" if self.messages_sha256 else ""
        return f"{messages}sha256    {self.sha256}"

    def save(self, disk: Disk = os) -> None:
        """Write result.json atomically. Raises OSError when it cannot be written."""
        data = msgspec.json.format(msgspec.json.encode(self), indent=2)
        write_file(Path(self.folder) / RESULT_FILE, data + b"\n", disk=disk)


def result_beside(recording: "Recording") -> Result | None:
    """Return the result of a run beside its recording; None where there is none of this one."""
    if recording.path.name != layout.RUN_FILE:
        return None
    try:
        data = read_file(recording.path.with_name(RESULT_FILE))
        result = msgspec.json.decode(data, type=Result)
    except (OSError, *UNDECODABLE):
        return None
    hashes = {result.messages_sha256, recording.messages_sha256} - {""}
    # The name of its participant is that of a log file too.
    is_named = not result.participant or is_name(result.participant)
    return result if is_named and len(hashes) < 2 else None


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal, or nothing where there is no regular file."""
    if not path.is_file():
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@functools.cache
def own_versions() -> Mapping[str, str]:
    """Return what the orchestrator runs on: Python, the processor, the libraries of the bus."""
    names = ("stepbus", "eclipse-zenoh", "mcap", "msgspec", "zstandard")
    return {
        "python": platform.python_version(),
        "machine": f"{sys.platform} {platform.machine()}",
        "cpu": cpu_model(),
        **{name: installed_version(name) for name in names},
    }


def cpu_model() -> str:
    """Return the processor's name; what it computes may differ from another's in the last bit."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
