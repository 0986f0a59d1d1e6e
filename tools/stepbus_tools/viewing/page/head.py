"""The head of a report: verdict, failure, figures, and the comparison of several runs."""

import os
import re
import shlex
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.reports import in_units
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.scenario.locate import builtin_name
from stepbus_participant import open_regular
from stepbus_tools.report.charts import Chart
from stepbus_tools.theme import engineering
from stepbus_tools.viewing.page.content import RunPage

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
    # Such as a mission's table: the last text of several lines of each source.
    long = {one.source: one.text for one in run.events if "\n" in one.text}
    last = "".join(f"<pre tabindex=0>{escape(text)}</pre>" for text in long.values())
    figures_shown = "" if run.label else f'<dl class="figures">{_cells(figures(run))}</dl>'
    return (
        f'<header class="{escape(verdict)}"><h1>{name} '
        f'<span class="verdict {escape(verdict)}">{escape(verdict)}</span></h1>'
        f"{_why(run)}{shown}{figures_shown}{f'<ul>{lines}</ul>' if lines else ''}"
        f"{last}"
        f"<details><summary>More about this run</summary><dl>{_cells(_facts(run))}</dl></details>"
        "</header>"
    )


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
    """Yield (name, text) of each figure. Several runs have them in one table."""
    result = run.result
    if result is None:
        yield "last step", str(run.last_step)
    else:
        yield "simulated", f"{result.simulated_s:g} s"
        yield "wall time", f"{result.wall_s:.2f} s"
        yield "real-time factor", f"{result.real_time_factor:.2f}"
    if errors := _charts(run):
        joint, worst = max(errors.items(), key=lambda row: row[1].largest)
        yield "largest error, whole run", f"{engineering(worst.largest, worst.unit)}, {joint}"
    charts = [(one, group.title) for group in run.groups for one in group.charts]
    used = [(c.used, c.title, joint) for c, joint in charts if c.used is not None]
    if used:
        share, what, joint = max(used)
        yield "nearest to a limit", f"{100 * share:.0f} %, {joint} {what}"
    if run.times:
        longest, name = max((part.longest, name) for name, part in run.times.items())
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


def again(run: RunPage) -> str:
    """Return the commands that run it again, as HTML."""
    rows = [run_again(run), f"stepbus rerun {shlex.quote(short(run.path))}"]
    return "".join(f"<pre>{escape(row)}</pre>" for row in rows if row)


def run_again(run: RunPage) -> str:
    """Return the command that runs its scenario again; empty where no result says how."""
    result = run.result
    if result is None or not result.file:
        return ""
    sets = [f" --set {shlex.quote(text)}" for text in result.overrides]
    faults = [f" --fault {shlex.quote(text)}" for text in result.faults]
    return "".join(["stepbus run ", shlex.quote(_scenario(result)), *sets, *faults])


def short(path: Path) -> str:
    """Return a path as seen from here, or its last two parts: nobody else has these folders."""
    try:
        return str(path.absolute().relative_to(Path.cwd()))
    except (OSError, ValueError):  # this folder is gone, or the path is elsewhere
        return str(Path(*path.parts[-2:]))


def _scenario(result: Result) -> str:
    """Return how to name its scenario: by its name where a package has it, or by its file."""
    path = Path(result.file)
    return builtin_name(path) or (short(path) if path.is_absolute() else result.file)


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
    """Return place and reason of a failure and the next steps, as HTML."""
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


_SAME = 1e-12


def comparison_html(runs: Sequence[RunPage]) -> str:
    """Return a table: outcome, settings, errors of joints, the figures that matter, run by run.

    An error has by how much it differs from that of the first run. It is empty for one run.
    """
    if len(runs) < 2:
        return ""
    names = "".join(
        f'<th><i class="sample l6 run{number % 4}"></i>{escape(run.label)}</th>'
        for number, run in enumerate(runs)
    )
    rows = "".join(
        f"<tr><th>{escape(name)}</th>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"
        for name, cells in [*_outcomes(runs), *_errors(runs), *_figures(runs)]
    )
    note = f"In parentheses: change from {runs[0].label}." if list(_errors(runs)) else ""
    return (
        f"<div class=scroll tabindex=0><table class=comparison><tr><td></td>{names}</tr>{rows}"
        f'</table></div><p class="note">{escape(note)}</p>'
    )


_Rows = Iterator[tuple[str, list[str]]]


def _outcomes(runs: Sequence[RunPage]) -> _Rows:
    words = [run.result.outcome if run.result else "unknown" for run in runs]
    yield "outcome", [f'<span class="word {escape(word)}">{escape(word)}</span>' for word in words]
    results = [run.result for run in runs]
    # What the scenario does not say.
    given = [[*one.overrides, *one.faults] if one else [] for one in results]
    if any(given):
        yield "settings, faults", ["<br>".join(map(escape, texts)) or "–" for texts in given]


def _errors(runs: Sequence[RunPage]) -> _Rows:
    """Yield the largest error of each joint."""
    errors = [_charts(run) for run in runs]
    for joint in dict.fromkeys(joint for charts in errors for joint in charts):
        first = errors[0].get(joint)
        yield f"largest error, {joint}", [_cell(charts.get(joint), first) for charts in errors]


def _figures(runs: Sequence[RunPage]) -> _Rows:
    shown = [dict(figures(run)) for run in runs]
    names = dict.fromkeys(name for row in shown for name in row)
    for name in names:
        if not name.startswith("largest error"):
            yield name, [escape(row.get(name, "–")) for row in shown]


def _charts(run: RunPage) -> dict[str, Chart]:
    """Return joint → the chart of its error."""
    return {
        group.title: chart
        for group in run.groups
        for chart in group.charts
        if chart.title == "error" and group.title in run.joints.measured
    }


def _cell(chart: Chart | None, first: Chart | None) -> str:
    if chart is None:
        return "–"
    text = escape(engineering(chart.largest, chart.unit))
    if first is None or first is chart or first.largest <= _SAME:
        return text
    share = round(100 * (chart.largest / first.largest - 1))
    kind = "less" if share < 0 else "more" if share else "same"
    sign = {"less": "−", "more": "+", "same": "±"}[kind]
    return f'{text} <span class="{kind}">({sign}{abs(share)}\u00a0%)</span>'
