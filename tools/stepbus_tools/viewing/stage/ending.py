"""What a page says first of a run that failed."""

import contextlib
import html
from pathlib import Path

from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.run.result import Result, result_beside
from stepbus_schemas import StepbusError


def result_in(folder: Path) -> Result | None:
    """Return the result of the run in a folder; None where there is none."""
    with contextlib.suppress(StepbusError, OSError), Recording(folder / layout.RUN_FILE) as run:
        return result_beside(run)
    return None


def failure_banner(result: Result | None, run: str = "") -> str:
    """Return that and why a run failed, as HTML; nothing of one that did not. run: its name."""
    if result is None or not result.exit_code:
        return ""
    who, why = html.escape(f"{run} failed".strip()), html.escape(result.cause or result.reason)
    return f'<div class="failed" role="alert"><b>{who}</b>: {why}</div>'
