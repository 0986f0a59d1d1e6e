"""What a process leaves undone that a participant has taken with it: result.json, and an error."""

import contextlib
import os
import re
import signal
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.recording.recover import recover
from stepbus_orchestrator.run.inprocess.turns import INTERRUPTED, PUBLISHED, TURN, Stage, Turns
from stepbus_orchestrator.run.kernel.state import at
from stepbus_orchestrator.run.result import RESULT_FILE, Result, file_sha256
from stepbus_participant import append_to

_LATE = (ExitCode.START, ExitCode.STEP_TIMEOUT, ExitCode.STOP_TIMEOUT)
_DIED = (ExitCode.START, ExitCode.DIED, ExitCode.DIED)
_DEADLINES = ("spawn_timeout, join_timeout and ready_timeout", "step_timeout", "stop_timeout")
"""Of each stage of a run."""
_LIBRARY = re.compile(r"/lib/python|/stepbus_orchestrator/")
_FRAME = re.compile(r'  File "(.+)", line (\d+) in (.+)')


def conclude(
    turns: Turns,
    pid: int,
    culprit: int,
    *,
    held_s: float | None = None,
    is_stopped: bool = False,
    code: int = 0,
) -> tuple[int, str]:
    """Write what a process cannot that has ended in the midst of a run.

    culprit: number of the participant; 0: unknown. held_s: how long that kept the process, which
    was killed [s]; None: it has ended by itself, with `code`. is_stopped: whether the process was
    stopped. Return the exit code of the run, and what to print on stderr.
    """
    will = turns.will()
    if not will:
        return ExitCode.INTERNAL, "stepbus: the process did not end, and was killed\n"
    end = _End(
        turns=turns,
        will=will,
        pid=pid,
        culprit=culprit,
        held_s=held_s,
        is_stopped=is_stopped,
        code=code,
    )
    if end.trace:
        with contextlib.suppress(OSError):
            file = append_to(Path(will["logs"], f"{end.name or 'native'}.log"))
            with os.fdopen(file, "a", encoding="utf-8") as log:
                log.write(f"{end.trace}\n")
    result, errors = _result(will, is_over=end.is_over), []
    if not result.exit_code:
        if result.recording.exists():
            errors = end.save(result)
        errors.append(end.error(result.step_ns))
    lines = [end.trace, *(f"stepbus: {error}" for error in errors)]
    # One that had failed before keeps its exit code.
    return result.exit_code or end.exit_code, "".join(f"{line}\n" for line in lines if line)


def _result(will: dict[str, Any], *, is_over: bool) -> Result:
    """Return what there is of a result, with the run's folder as it is known from anywhere."""
    result = msgspec.json.decode(will["result"], type=Result)
    folder = Path(will["logs"]).parent
    if is_over:
        with contextlib.suppress(OSError, msgspec.DecodeError):
            result = msgspec.json.decode((folder / RESULT_FILE).read_bytes(), type=Result)
    return msgspec.structs.replace(result, folder=str(folder))


def _frames(trace: str) -> list[re.Match[str]]:
    return [frame for frame in map(_FRAME.match, trace.splitlines()) if frame]


@dataclass(frozen=True, kw_only=True)
class _End:
    """How a process ended; see `conclude`."""

    turns: Turns
    will: dict[str, Any]
    pid: int
    culprit: int
    held_s: float | None
    is_stopped: bool
    code: int

    @cached_property
    def trace(self) -> str:
        return self.turns.trace()

    @cached_property
    def number(self) -> int:
        """Return who it was; where unknown, the only participant with a file in the tracebacks."""
        files = self.will["files"]
        seen = {frame[1] for frame in _frames(self.trace) if files.count(frame[1]) == 1}
        return self.culprit or (1 + files.index(*seen) if len(seen) == 1 else 0)

    @property
    def name(self) -> str | None:
        return self.will["names"][self.number - 1] if self.number else None

    @property
    def is_over(self) -> bool:
        return self.turns.stage >= Stage.OVER

    @property
    def phase(self) -> int:
        """Return which of the phases of the run it was."""
        return self.turns.stage - Stage.READY

    @property
    def step(self) -> int:
        """Return the step whose outputs the participant owes; −1 before the first."""
        if not self.number or self.turns.stage is Stage.READY:
            return -1
        every: int = self.will["every"][self.number - 1]
        return int(self.turns.words[PUBLISHED + self.number]) * every

    @property
    def exit_code(self) -> ExitCode:
        if self.is_over:
            return ExitCode.STOP_TIMEOUT
        if self.held_s is None:
            return _DIED[self.phase]
        return ExitCode.INTERRUPTED if self.turns.words[INTERRUPTED] else _LATE[self.phase]

    def error(self, step_ns: int) -> str:
        who = f"{self.name or 'a participant'} (pid {self.pid})"
        if self.is_over:
            return (
                f"after the last step: a thread or an exit function of {who} kept the "
                f"process alive{self._where()}; it was killed; the recording is complete"
            )
        when = at(self.step, step_ns)
        if self.held_s is None:
            what = f"exited with code {self.code}, and the process that it shares with it"
            if self.code < 0:
                number = signal.Signals(-self.code).name
                what = f"had its turn when {number} killed the process that all participants share"
        else:
            when = f"interrupted by the user; {when}" if self.turns.words[INTERRUPTED] else when
            what = self._kept(self.held_s)
        log = f"; its log: {self.will['logs']}/{self.name}.log" if self.name else ""
        return f"{when}: {who} {what}{log}"

    def _kept(self, held_s: float) -> str:
        if self.is_stopped:
            return (
                f"had its turn while the process that all participants share was stopped by a "
                f"signal or a debugger, for {held_s:.1f} s, and then killed"
            )
        if not self.number or self.number != self.turns.words[TURN]:
            return f"has a thread that held the GIL for {held_s:.1f} s: the process was killed"
        limit_s = self.will["limits"][self.number - 1][self.phase]
        return (
            f"has been computing for {held_s:.1f} s{self._where()}, and could not be "
            f"interrupted: the process that it shares was killed; deadline {limit_s:g} s "
            f"(participants.{self.name}.{_DEADLINES[self.phase]})"
        )

    def _where(self) -> str:
        """Return `, at file.py:12 in update`: the newest line that is not the library's."""
        _, _, current = self.trace.rpartition("Current thread")
        frames = _frames(current.partition("\n\n")[0])
        own = [frame for frame in frames if not _LIBRARY.search(frame[1])] or frames
        return f", at {Path(own[0][1]).name}:{own[0][2]} in {own[0][3]}" if own else ""

    def save(self, result: Result) -> list[str]:
        """Repair the recording and write result.json, each as far as that goes; return errors."""
        steps, errors = result.steps, []
        if not self.is_over:
            try:
                steps = recover(result.recording, result.recording, in_place=True).last_step + 1
            except RecordingFailed as exc:
                errors.append(str(exc))
        complete = msgspec.structs.replace(
            result,
            outcome="failed",
            exit_code=int(self.exit_code),
            reason=self.error(result.step_ns),
            participant=self.name if self.exit_code != ExitCode.INTERRUPTED else None,
            at_step=max(self.step, steps) if self.is_over else self.step,
            steps=steps,
            sha256=file_sha256(result.recording),
        )
        with contextlib.suppress(OSError):
            complete.save()
        return errors
