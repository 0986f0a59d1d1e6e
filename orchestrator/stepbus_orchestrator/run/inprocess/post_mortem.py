"""What a process leaves undone that a participant has taken with it: result.json, and an error."""

import contextlib
import re
import signal
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.recording.recover import recover
from stepbus_orchestrator.run.inprocess.heartbeat import (
    INTERRUPTED,
    PUBLISHED,
    TURN,
    Heartbeat,
    Stage,
    Watcher,
)
from stepbus_orchestrator.run.kernel.state import at
from stepbus_orchestrator.run.result import RESULT_FILE, Result, file_sha256

_LATE = (ExitCode.START, ExitCode.STEP_TIMEOUT, ExitCode.STOP_TIMEOUT)
_DIED = (ExitCode.START, ExitCode.DIED, ExitCode.DIED)
_DEADLINES = ("spawn_timeout, join_timeout and ready_timeout", "step_timeout", "stop_timeout")
"""Of each stage of a run."""
_LIBRARY = re.compile(r"/lib/python|/stepbus_orchestrator/")
_FRAME = re.compile(r'^  File "(.+)", line (\d+) in (.+)$', re.MULTILINE)


def conclude(
    heartbeat: Heartbeat, pid: int, *, killer: Watcher | None = None, code: int = 0
) -> tuple[int, str]:
    """Write what a process cannot that has ended in the midst of a run.

    killer: has killed it; None: it has ended by itself, with `code`. Return the exit code of the
    run, and what to print on stderr.
    """
    will = heartbeat.will()
    if not will:
        return ExitCode.INTERNAL, "stepbus: the process did not end, and was killed\n"
    end = _End(heartbeat, will, pid, killer, code)
    result = _result(will, is_over=end.is_over)
    lines = [end.trace] if end.trace else []
    if not result.exit_code:
        lines += [f"stepbus: {error}" for error in end.save(result)]
    # One that had failed before keeps its exit code.
    return result.exit_code or end.exit_code, "".join(f"{line}\n" for line in lines)


def _result(will: dict[str, Any], *, is_over: bool) -> Result:
    """Return what there is of a result, with the run's folder as it is known from anywhere."""
    result = msgspec.json.decode(will["result"], type=Result)
    folder = Path(will["logs"]).parent
    if is_over:
        with contextlib.suppress(OSError, msgspec.DecodeError):
            result = msgspec.json.decode((folder / RESULT_FILE).read_bytes(), type=Result)
    return msgspec.structs.replace(result, folder=str(folder))


class _End:
    """How a process ended; see `conclude`.

    name: of the participant that is to blame; None: unknown. step: whose outputs that owes; −1
    before the first. phase: which of the phases of the run it was.
    """

    def __init__(
        self,
        heartbeat: Heartbeat,
        will: dict[str, Any],
        pid: int,
        killer: Watcher | None,
        code: int,
    ) -> None:
        self._will = will
        self._pid = pid
        self._killer = killer
        self._code = code
        self._turn = int(heartbeat.words[TURN])
        self._is_interrupted = bool(heartbeat.words[INTERRUPTED])
        self.trace = heartbeat.trace()
        others, _, current = self.trace.rpartition("Current thread")
        self._current, _, more = current.partition("\n\n")
        self._others = others + more
        self.is_over = heartbeat.stage >= Stage.OVER
        self.phase = heartbeat.stage - Stage.READY
        number = self._number
        self.name = will["names"][number - 1] if number else None
        self.step = -1
        if number and heartbeat.stage is not Stage.READY:
            self.step = int(heartbeat.words[PUBLISHED + number])

    @cached_property
    def _number(self) -> int:
        """Return the culprit's number; in no turn of its own, by the only file in a traceback."""
        is_other = not self._turn or (self._killer is not None and self._killer.is_waiting)
        for trace in (self._others, self._current) if is_other else ():
            files = self._will["files"]
            seen = {file for file, _, _ in _FRAME.findall(trace) if files.count(file) == 1}
            if len(seen) == 1:
                return 1 + int(files.index(*seen))
        return self._turn

    @property
    def exit_code(self) -> ExitCode:
        if self.is_over:
            return ExitCode.STOP_TIMEOUT
        if self._killer is None:
            return _DIED[self.phase]
        return ExitCode.INTERRUPTED if self._is_interrupted else _LATE[self.phase]

    def _error(self, step_ns: int) -> str:
        who = f"{self.name or 'a participant'} (pid {self._pid})"
        if self.is_over:
            return (
                f"after the last step: a thread or an exit function of {who} kept the "
                f"process alive{self._where()}; it was killed; the recording is complete"
            )
        when = at(self.step, step_ns)
        if self._killer is not None:
            when = f"interrupted by the user; {when}" if self._is_interrupted else when
            what = self._late(self._killer)
        elif self._code < 0:
            number = signal.Signals(-self._code).name
            what = f"had its turn when {number} killed the process that all participants share"
        else:
            what = f"exited with code {self._code}, and the process that it shares with it"
        log = f"; its log: {self._will['logs']}/{self.name}.log" if self.name else ""
        return f"{when}: {who} {what}{log}"

    def _late(self, killer: Watcher) -> str:
        if killer.is_stopped:
            return (
                f"had its turn while the process that all participants share was stopped by a "
                f"signal or a debugger, for {killer.held_s:.1f} s, and then killed"
            )
        if not self._number or self._number != self._turn:
            return (
                f"has a thread that held the GIL for {killer.held_s:.1f} s: the process was killed"
            )
        limit_s = self._will["limits"][self._number - 1][self.phase]
        return (
            f"has been computing for {killer.held_s:.1f} s{self._where()}, and could not be "
            f"interrupted: the process that it shares was killed; deadline {limit_s:g} s "
            f"(participants.{self.name}.{_DEADLINES[self.phase]})"
        )

    def _where(self) -> str:
        """Return `, at file.py:12 in update`: the newest line that is not the library's."""
        frames = _FRAME.findall(self._current)
        for file, line, function in [f for f in frames if not _LIBRARY.search(f[0])] or frames:
            return f", at {Path(file).name}:{line} in {function}"
        return ""

    def save(self, result: Result) -> list[str]:
        """Repair the recording and write result.json, each as far as that goes; return errors."""
        error = self._error(result.step_ns)
        if not result.recording.exists():
            return [error]
        steps, errors = result.steps, [error]
        if not self.is_over:
            try:
                steps = recover(result.recording, result.recording, in_place=True).last_step + 1
            except RecordingFailed as exc:
                errors.insert(0, str(exc))
        complete = msgspec.structs.replace(
            result,
            outcome="failed",
            exit_code=int(self.exit_code),
            reason=error,
            participant=self.name if self.exit_code != ExitCode.INTERRUPTED else None,
            at_step=max(self.step, steps) if self.is_over else self.step,
            steps=steps,
            sha256=file_sha256(result.recording),
        )
        with contextlib.suppress(OSError):
            complete.save()
        return errors
