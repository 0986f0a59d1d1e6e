"""What a page says first of a run that failed: where, why, the end of a log, what to do next."""

import os
import re
from collections.abc import Iterator
from html import escape
from pathlib import Path

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.result import Result
from stepbus_participant import open_regular

from .again import run_again, short
from .content import RunPage

_PLACE = re.compile(r"^step \d+ \(t = [^)]*\): ")
"""How a reason begins, which the line above it says."""
_FILE = re.compile(r'File "(/[^"\n]*)"')
"""A line of a traceback: nobody else has this machine's folders."""
_LOG_LINES, _LOG_BYTES = 8, 4000
_OF_A_PARTICIPANT = (ExitCode.FAULT, ExitCode.DIED)
_ADVICE = {
    ExitCode.INTERNAL: "Report it if the defect is in stepbus.",
    ExitCode.START: "Raise its time-out in the scenario if it is only slow to start.",
    ExitCode.STEP_TIMEOUT: "Check what it computes, or raise its step_timeout.",
    ExitCode.BUS: "Choose another bus.port, or leave it out.",
    ExitCode.RECORDING: "Free disk space, or choose another --out.",
    ExitCode.STOP_TIMEOUT: "Check what its close waits for; the recording is complete.",
    ExitCode.INTERRUPTED: "No failure: the user stopped the run; it is recorded up to that step.",
}
"""As in docs/exit-codes.md."""


def failure_html(run: RunPage, result: Result) -> str:
    """Return where and why a run failed, and what to do next."""
    code = ExitCode(result.exit_code)
    place = f"step {result.at_step}, t = {result.at_step * result.step_ns * 1e-9:.3f} s"
    blamed = f"{result.participant} failed" if result.participant else "It failed"
    blamed = "Interrupted" if code == ExitCode.INTERRUPTED else blamed
    where = f"{blamed} at {place}" if result.at_step >= 0 else f"{blamed} before the first step"
    why = _PLACE.sub("", run.local(result.reason))
    steps = "".join(f"<li>{step}</li>" for step in _steps(run, result, code))
    # Among several runs, the table of their figures comes next.
    more = f"{_log_html(run, result)}<h2>What to do next</h2><ol>{steps}</ol>"
    return (
        f'<div class="failure"><p class="where">{escape(where)}</p>'
        f'<p class="reason">{escape(why)} <span class="code">(exit code {code.value}, '
        f"{code.name})</span></p>{'' if run.label else more}</div>"
    )


def _steps(run: RunPage, result: Result, code: ExitCode) -> Iterator[str]:
    """Yield what to do next, as HTML."""
    if result.faults:
        faults = "; ".join(result.faults)
        yield f"A fault was injected on purpose: <code>{escape(faults)}</code>."
    if result.participant and code != ExitCode.INTERRUPTED:
        log = f"logs/{result.participant}.log"
        yield f"Read its log, <code>{escape(log)}</code> in the folder of the run."
    if code in _ADVICE:
        yield escape(_ADVICE[code])
    command = run_again(run)
    if command and result.at_step > 0 and code != ExitCode.INTERRUPTED:
        text = f"{command} --pause-at {result.at_step - 1}"
        yield f"Reproduce it, and pause just before it: <code>{escape(text)}</code>"
    if command and result.participant and code in _OF_A_PARTICIPANT:
        text = f"{command} --debug {result.participant}"
        yield f"Or run it in a debugger: <code>{escape(text)}</code>"


def _log_html(run: RunPage, result: Result) -> str:
    """Return the last lines of the log of the participant to blame; nothing where there is none."""
    path = run.path.parent / "logs" / f"{result.participant}.log"
    try:
        with os.fdopen(open_regular(path), "rb") as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - _LOG_BYTES))
            text = file.read().decode("utf-8", "replace")
    except OSError:
        return ""
    text = _FILE.sub(lambda match: f'File "{short(Path(match[1]))}"', run.local(text))
    lines = text.rstrip().splitlines()[-_LOG_LINES:]
    name = escape(f"{result.participant}.log")
    shown = escape("\n".join(lines))
    return f"<p>The end of {name}:</p><pre tabindex=0>{shown}</pre>" if lines else ""
