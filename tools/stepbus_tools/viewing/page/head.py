"""What a page says of a run first: its verdict and the figures that matter."""

from collections.abc import Iterator
from html import escape

from stepbus_orchestrator.run.reports import in_units
from stepbus_tools.report.units import engineering

from .again import short
from .content import RunPage
from .failure import failure_html

_MOST_WARNINGS = 10


def head(run: RunPage) -> str:
    """Return verdict and reason of a run, its problems and its figures."""
    result = run.result
    name = escape(run.name + (f" ({run.label})" if run.label else ""))
    problems = list(run.problems)
    if result is not None:
        warnings = result.warnings[:_MOST_WARNINGS]
        problems += [f"{w.level}: {w.source}, step {w.step}: {w.text}" for w in warnings]
    verdict = result.outcome if result else "unknown"
    shown = "".join(f'<p class="problem">{escape(text)}</p>' for text in problems)
    lines = "".join(f"<li>{escape(line)}</li>" for line in run.lines)
    figures_shown = "" if run.label else f'<dl class="figures">{_cells(figures(run))}</dl>'
    return (
        f'<header class="{escape(verdict)}"><h1>{name} '
        f'<span class="verdict {escape(verdict)}">{escape(verdict)}</span></h1>'
        f"{_why(run)}{shown}{figures_shown}{f'<ul>{lines}</ul>' if lines else ''}"
        f"{_last_words(run)}"
        f"<details><summary>More about this run</summary><dl>{_cells(_facts(run))}</dl></details>"
        "</header>"
    )


def _last_words(run: RunPage) -> str:
    """Return the last text of several lines of each source, such as a mission's table."""
    last = {one.source: one.text for one in run.events if "\n" in one.text}
    return "".join(f"<pre tabindex=0>{escape(text)}</pre>" for text in last.values())


def _why(run: RunPage) -> str:
    """Return why a run ended, as HTML."""
    result = run.result
    if result is not None and result.exit_code:
        return failure_html(run, result)
    why = "There is no result.json next to the recording."
    if result is not None:
        why = "It finished." if result.reason == result.outcome else run.local(result.reason)
    return f'<p class="reason">{escape(why)}</p>'


def _cells(rows: Iterator[tuple[str, str]]) -> str:
    return "".join(
        f"<div><dt>{key}</dt><dd>{escape(value).replace('_', '_<wbr>')}</dd></div>"
        for key, value in rows
    )


def figures(run: RunPage) -> Iterator[tuple[str, str]]:
    """Yield the figures that matter: name and text. Among several runs they are in one table."""
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
        yield "largest error, whole run", f"{engineering(worst.largest, worst.unit)}, {joint}"
    used = [(c.used, c.title, joint) for c, joint in charts if c.used is not None]
    if used:
        share, what, joint = max(used)
        yield "nearest to a limit", f"{100 * share:.0f} %, {joint} {what}"
    if run.times:
        longest, name = max((float(t.compute.max()), name) for name, t in run.times.items())
        yield "longest step", f"{in_units(longest)}, {name}"
    if result is not None:
        counts = ((result.warning_count, "warning"), (len(result.faults), "fault"))
        rows = [f"{count} {word}{'s' * (count > 1)}" for count, word in counts if count]
        yield "warnings, faults", ", ".join(rows) or "none"


def _facts(run: RunPage) -> Iterator[tuple[str, str]]:
    yield "recording", short(run.path)
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
