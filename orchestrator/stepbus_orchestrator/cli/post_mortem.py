"""What a process leaves undone that a participant has taken with it: result.json, and a sentence.

Started by who watched it: `post_mortem DESCRIPTOR PID NUMBER HOW`. Its exit code is the run's.
"""

import contextlib
import os
import re
import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.cli.output import print_error, visible
from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.processes.turns import DEADLINES, Row, Stage, Turns, Word
from stepbus_orchestrator.recording.recover import recover
from stepbus_orchestrator.run.result import RESULT_FILE, Result, file_sha256
from stepbus_participant import append_to

_LATE = {"ready": ExitCode.START, "step": ExitCode.STEP_TIMEOUT, "stop": ExitCode.STOP_TIMEOUT}
_DIED = {"ready": ExitCode.START, "step": ExitCode.DIED, "stop": ExitCode.DIED}
_TIMEOUTS = {
    "ready": "spawn_timeout, join_timeout and ready_timeout",
    "step": "step_timeout",
    "stop": "stop_timeout",
}
_LIBRARY = re.compile(r"/lib/python|/stepbus_orchestrator/")
_FRAME = re.compile(r'  File "(.+)", line (\d+) in (.+)')


@dataclass(frozen=True, kw_only=True)
class _End:
    """How a process ended. name: of the participant, if any. deadline: which of `DEADLINES`."""

    turns: Turns
    will: dict[str, Any]
    pid: int
    number: int
    how: str

    @property
    def name(self) -> str | None:
        return self.will["names"][self.number - 1] if self.number else None

    @property
    def deadline(self) -> str:
        return DEADLINES[int(self.turns.words[Row.DEADLINE + self.number])]

    @property
    def step(self) -> int:
        """Return the step whose outputs the participant owes; −1 before the first."""
        if not self.number or self.deadline == "ready":
            return -1
        every: int = self.will["every"][self.number - 1]
        return self.turns.steps(self.number) * every

    @property
    def is_over(self) -> bool:
        return self.turns.words[Word.STAGE] >= Stage.OVER

    def code(self) -> ExitCode:
        if self.is_over:
            return ExitCode.STOP_TIMEOUT
        if self.how.startswith("interrupted"):
            return ExitCode.INTERRUPTED
        return (_LATE if self.how.startswith("late") else _DIED)[self.deadline]

    def sentence(self, step_ns: int) -> str:
        who = f"{self.name or 'a participant'} (pid {self.pid})"
        log = f"; its log: {self.will['logs']}/{self.name}.log" if self.name else ""
        if self.is_over:
            return (
                f"after the last step: a thread or an exit function of {who} kept the process, "
                "which was killed; the recording is complete"
            )
        at = "before the first step"
        if self.step >= 0:
            at = f"step {self.step} (t = {self.step * step_ns * 1e-9:.3f} s)"
        kind, _, number = self.how.partition(" ")
        if kind in {"late", "interrupted"}:
            at = f"interrupted by the user; {at}" if kind == "interrupted" else at
            return f"{at}: {who} {self._kept(number)}{log}"
        ended = f"exited with code {number}"
        if kind == "signal":
            ended = f"was killed by {signal.Signals(int(number)).name}"
        return f"{at}: {who} {ended}, and the process that it shares with it{log}"

    def _kept(self, held_s: str) -> str:
        if not self.number or self.number != self.turns.words[Word.TURN]:
            return f"has a thread that kept Python's lock for {held_s} s: the process was killed"
        limit_s = self.turns.words[Row.LIMIT + self.number]
        return (
            f"has been computing for {held_s} s{_where(self.turns.trace())}, and could not be "
            f"interrupted: the process that it shares was killed; deadline {limit_s:g} s "
            f"(participants.{self.name}.{_TIMEOUTS[self.deadline]})"
        )


def _where(trace: str) -> str:
    """Return `, at file.py:12 in update`: the newest line that is not the library's."""
    _, _, current = trace.rpartition("Current thread")
    frames = [row for row in map(_FRAME.match, current.partition("\n\n")[0].splitlines()) if row]
    own = [row for row in frames if not _LIBRARY.search(row[1])] or frames
    return f", at {Path(own[0][1]).name}:{own[0][2]} in {own[0][3]}" if own else ""


def _save(end: _End, result: Result) -> None:
    """Repair the recording and write result.json; each as far as that goes."""
    sentence, steps = end.sentence(result.step_ns), result.steps
    if not end.is_over:
        try:
            steps = recover(result.recording, result.recording, in_place=True).last_step + 1
        except RecordingFailed as exc:
            print_error(str(exc))
    complete = msgspec.structs.replace(
        result,
        outcome="failed",
        exit_code=int(end.code()),
        reason=sentence,
        participant=end.name if end.code() != ExitCode.INTERRUPTED else None,
        at_step=max(end.step, steps) if end.is_over else end.step,
        steps=steps,
        sha256=file_sha256(result.recording),
    )
    with contextlib.suppress(OSError):
        complete.save()


def _result(will: dict[str, Any], *, is_over: bool) -> Result:
    """Return what there is of a result, with the run's folder as it is found from anywhere."""
    result = msgspec.json.decode(will["result"], type=Result)
    folder = Path(will["logs"]).parent
    if is_over:
        with contextlib.suppress(OSError, msgspec.DecodeError):
            result = msgspec.json.decode((folder / RESULT_FILE).read_bytes(), type=Result)
    return msgspec.structs.replace(result, folder=str(folder))


def _main() -> int:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    file, pid, number = map(int, sys.argv[1:4])
    turns = Turns(file)
    will = turns.read()
    if not will:
        print_error("the process did not end, and was killed")
        return ExitCode.INTERNAL
    end = _End(turns=turns, will=will, pid=pid, number=number, how=sys.argv[4])
    result = _result(will, is_over=end.is_over)
    trace = turns.trace()
    if trace:
        sys.stderr.write(visible(trace) + "\n")
        with contextlib.suppress(OSError):
            file = append_to(Path(will["logs"], f"{end.name or 'native'}.log"))
            with os.fdopen(file, "a", encoding="utf-8") as log:
                log.write(trace + "\n")
    if result.exit_code:
        # It had failed before.
        return result.exit_code
    if result.recording.exists():
        _save(end, result)
    print_error(end.sentence(result.step_ns))
    return int(end.code())


if __name__ == "__main__":
    raise SystemExit(_main())
