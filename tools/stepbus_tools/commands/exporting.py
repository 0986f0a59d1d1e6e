"""Writes what a recording becomes: exports, plots, reports."""

from dataclasses import make_dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from stepbus_orchestrator.cli.info import shown_size
from stepbus_orchestrator.cli.terminal.output import print_error, say
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import WiringError
from stepbus_tools.report.charts import find_signals, signal_names
from stepbus_tools.report.picture import save
from stepbus_tools.viewing.exports import damage_line, export, exporters, progress_bar
from stepbus_tools.viewing.page import write_page

_EXPORTERS = exporters()
_OPTIONS = {name: row for one in _EXPORTERS.values() for name, row in one.options.items()}


def _flag(name: str) -> str:
    """Return the option of a parameter; `from_` is --from."""
    return f"--{name.rstrip('_').replace('_', '-')}"


def targets() -> Any:
    """Return the options of an export: what all installed exporters take."""
    paths: list[Any] = [
        (name, Annotated[Path | None, Parameter(metavar=one.metavar, help=one.help)], None)
        for name, one in _EXPORTERS.items()
    ]
    options = [
        (name, Annotated[str, Parameter(name=_flag(name), metavar=metavar, help=text)], "")
        for name, (metavar, text) in _OPTIONS.items()
    ]
    made: Any = make_dataclass(
        "Targets", paths + options, kw_only=True, namespace={"__module__": __name__}
    )
    return made


def export_command(recording: Path, *, targets: Any) -> int:
    """Write a recording in other formats."""
    given = vars(targets) if targets else {}
    paths = {form: given[form] for form in _EXPORTERS if given.get(form) is not None}
    if not paths:
        raise WiringError("nothing to export; give a target, e.g. --parquet tables")
    options = {name: given[name] for name in _OPTIONS}
    for name, value in options.items():
        users = [form for form, one in _EXPORTERS.items() if name in one.options]
        if value and not paths.keys() & set(users):
            raise WiringError(f"{_flag(name)} goes with --{' or --'.join(users)}")
    is_whole = True
    with Recording(recording) as opened:
        for form, done in export(opened, paths, progress=progress_bar, **options):
            for line in done.problems:
                print_error(line)
            total = shown_size(sum(path.stat().st_size for path in done.paths))
            files = f", {len(done.paths)} files" if len(done.paths) > 1 else ""
            say(f"wrote {paths[form]} ({total}{files})")
            is_whole = is_whole and not done.lost
        if damage := damage_line(opened):
            print_error(damage)
    return ExitCode.FINISHED if is_whole else ExitCode.RECORDING


def plot_command(recording: Path, *signals: str, out: Path | None) -> int:
    """Draw signals of a recording, or list them."""
    with Recording(recording) as opened:
        if not signals:
            for name in signal_names(opened):
                say(name)
            return ExitCode.FINISHED
        charts = [chart for text in signals for chart in find_signals(opened, text)]
        target = out or opened.path.with_name("plot.png")
        save(str(opened.path), charts, target)
    say(f"wrote {target}")
    return ExitCode.FINISHED


def report_command(recording: Path, *others: Path, out: Path | None, no_replay: bool) -> int:
    """Write the page of recordings."""
    problems: list[str] = []
    path = write_page([recording, *others], out, problems, has_replay=not no_replay)
    for line in problems:
        print_error(line)
    say(f"wrote {path}")
    return ExitCode.FINISHED
