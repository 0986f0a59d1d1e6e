"""What a page says of a run first: its verdict, the figures that matter, how to run it again."""

import shlex
from collections.abc import Iterator
from html import escape
from pathlib import Path

from stepbus_orchestrator.run.reports import in_units
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.scenario.locate import builtin_name
from stepbus_tools.report.units import engineering

from .content import RunPage
from .mission import summary_html

_MOST_WARNINGS = 10


def head(run: RunPage) -> str:
    """Return verdict and reason of a run, its problems and its figures."""
    result = run.result
    name = escape(run.name + (f" ({run.label})" if run.label else ""))
    verdict, why = "unknown", "There is no result.json beside the recording."
    problems = list(run.problems)
    if result is not None:
        verdict, why = result.outcome, run.local(result.reason)
        why = "It ran to its end." if why == verdict else why
        if result.exit_code and result.participant:
            why += f" ({result.participant}, step {result.at_step}, exit code {result.exit_code})"
        warnings = result.warnings[:_MOST_WARNINGS]
        problems += [f"{w.level}: {w.source}, step {w.step}: {w.text}" for w in warnings]
    shown = "".join(f'<p class="problem">{escape(text)}</p>' for text in problems)
    lines = "".join(f"<li>{escape(line)}</li>" for line in run.lines)
    return (
        f'<header class="{escape(verdict)}"><h1>{name} '
        f'<span class="verdict {escape(verdict)}">{escape(verdict)}</span></h1>'
        f'<p class="reason">{escape(why)}</p>{shown}'
        f'<dl class="figures">{_cells(_figures(run))}</dl>{f"<ul>{lines}</ul>" if lines else ""}'
        f"{summary_html(run.events)}"
        f"<details><summary>More about this run</summary><dl>{_cells(_facts(run))}</dl></details>"
        "</header>"
    )


def _cells(rows: Iterator[tuple[str, str]]) -> str:
    return "".join(f"<div><dt>{key}</dt><dd>{escape(value)}</dd></div>" for key, value in rows)


def _figures(run: RunPage) -> Iterator[tuple[str, str]]:
    """Yield the figures that matter."""
    result = run.result
    if result is None:
        yield "last step", str(run.last_step)
    else:
        yield "simulated", f"{result.simulated_s:g} s"
        yield "wall time", f"{result.wall_s:.2f} s"
        yield "real-time factor", f"{result.real_time_factor:.2f}"
    charts = [(one, group.title) for group in run.groups for one in group.charts]
    errors = [row for row in charts if row[0].title == "error" and row[1] in run.joints.measured]
    if errors:
        worst, joint = max(errors, key=lambda row: row[0].largest)
        yield "largest error", f"{engineering(worst.largest, worst.unit)}, {joint}"
    used = [(c.used, c.title, joint) for c, joint in charts if c.used is not None]
    if used:
        share, what, joint = max(used)
        yield "nearest to a limit", f"{100 * share:.0f} %, {joint} {what}"
    if run.times:
        slow = max(run.times, key=lambda name: run.times[name].longest)
        yield "longest step", f"{in_units(run.times[slow].longest * 1e-3)}, {slow}"
    if result is not None:
        yield "warnings, faults", f"{result.warning_count}, {len(result.faults)}"


def _facts(run: RunPage) -> Iterator[tuple[str, str]]:
    yield "recording", _short(run.path)
    result = run.result
    if result is None:
        return
    yield "steps", f"{result.steps} of {result.step_ns * 1e-6:g} ms"
    yield "seed, window, transport", f"{result.seed}, {result.window}, {result.transport}"
    if result.faults:
        yield "faults", ", ".join(result.faults)
    drops = ", ".join(f"{count} by {name}" for name, count in result.drops.items() if count)
    if drops:
        yield "dropped messages", drops
    yield "hash of its messages", result.messages_sha256[:16]
    yield "sha256 of its file", result.sha256[:16]
    yield from result.versions.items()


def _short(path: Path) -> str:
    """Return the last two parts of a path: nobody else has this machine's folders."""
    return str(Path(*path.parts[-2:]))


def again(run: RunPage) -> str:
    """Return the commands that run it again."""
    rows = [f"stepbus rerun {shlex.quote(_short(run.path))}"]
    if run.result is not None and run.result.file:
        sets = [f" --set {shlex.quote(text)}" for text in run.result.overrides]
        faults = [f" --fault {shlex.quote(text)}" for text in run.result.faults]
        words = "".join([shlex.quote(_scenario(run.result)), *sets, *faults])
        rows.insert(0, f"stepbus run {words}")
    return "".join(f"<pre>{escape(row)}</pre>" for row in rows)


def _scenario(result: Result) -> str:
    """Return how to name its scenario: by its name where a package has it, or by its file."""
    path = Path(result.file)
    return builtin_name(path) or (_short(path) if path.is_absolute() else result.file)
