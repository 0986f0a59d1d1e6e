"""`stepbus diff` and `replay`: two recordings, or one participant and its recording."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.tolerance import Tolerance, parse_tolerance, read_tolerance
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.cli.syntax.test import ToleranceOptions
from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.cli.trust import check_trust
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import ReplayResult, replay
from stepbus_orchestrator.replay.trust import find_source
from stepbus_schemas import WiringError


def diff_command(first: Path, second: Path, *, tolerance: ToleranceOptions, json: bool) -> int:
    """Compare two recordings."""
    difference = diff(first, second, _tolerance(tolerance))
    code = ExitCode.FINISHED if difference.equal else ExitCode.DIFFERENT
    return Answer(value=difference, lines=[difference.text()], code=code).show(as_json=json)


def _tolerance(options: ToleranceOptions, participant: str = "") -> Tolerance:
    """Return the tolerance; the command line takes precedence over the file."""
    from_file = Tolerance() if options.tolerance is None else read_tolerance(options.tolerance)
    return from_file | parse_tolerance(options.abs, options.rel, options.ignore, participant)


def replay_command(
    recording: Path,
    *,
    participant: str,
    tolerance: ToleranceOptions,
    recorded: bool,
    source: Path | None,
    program: Sequence[str],
    trust: bool,
    json: bool,
    **more: Any,
) -> int:
    """Run a participant on its recorded inputs, and compare its outputs. more: as of `replay`."""
    if source and (recorded or program):
        other = "--recorded" if recorded else "--exec, whose program starts in the current folder"
        raise WiringError(f"--source cannot be combined with {other}")
    is_copy = recorded or bool(program)
    source = None if is_copy else find_source(Recording(recording), source)
    if source is None:
        check_trust(Recording(recording), participant, trust=trust, own_program=bool(program))
    with (
        displayed(f"replay of {participant}", quiet=json) as display,
        interruptible() as interrupt,
    ):
        result = replay(
            recording,
            participant,
            tolerance=_tolerance(tolerance, participant),
            recorded=source is None,
            source=source,
            program=program or None,
            observer=display,
            interrupt=interrupt,
            **more,
        )
    return Answer(
        value={**msgspec.structs.asdict(result), "steps_per_s": result.steps_per_s},
        lines=_replayed(result),
        code=ExitCode.FINISHED if result.equal else ExitCode.DIFFERENT,
    ).show(as_json=json)


def _replayed(result: ReplayResult) -> Iterator[str]:
    yield result.text()
    yield f"wall time {result.wall_s:.2f} s ({result.steps_per_s:.0f} steps/s)"
    if result.updated is not None:
        replaced = sum(port.within + port.different for port in result.ports)
        yield f"wrote {result.updated}: replaced {replaced} messages of {result.participant}"
