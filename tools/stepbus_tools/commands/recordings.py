"""What a recording becomes: `stepbus export`, `plot` and `report`."""

from typing import Any

from stepbus_orchestrator.cli.info import shown_size
from stepbus_orchestrator.cli.terminal.output import print_error, say
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import WiringError
from stepbus_tools.commands.declared import Plot, Report
from stepbus_tools.exporters import exporters
from stepbus_tools.report.charts import find_signals, signal_names
from stepbus_tools.report.picture import save
from stepbus_tools.viewing.exports import damage_line, export, progress_bar
from stepbus_tools.viewing.page import write_page


def export_command(given: Any) -> int:
    """Write a recording in all formats that were asked for. given: an `Export`, completed."""
    known, values = exporters(), vars(given)
    paths = {form: values[form] for form in known if values[form] is not None}
    options = {name: values[name] or "" for one in known.values() for name in one.options}
    if not paths:
        raise WiringError("nothing to export; give a target, e.g. --parquet tables")
    for name, value in options.items():
        users = [form for form, one in known.items() if name in one.options]
        if value and not paths.keys() & set(users):
            raise WiringError(f"--{name.rstrip('_')} goes with --{' or --'.join(users)}")
    is_whole = True
    with Recording(given.recording) as opened:
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


def plot_command(given: Plot) -> int:
    """Draw signals, or list all that there are."""
    with Recording(given.recording) as opened:
        if not given.signals:
            for name in signal_names(opened):
                say(name)
            return ExitCode.FINISHED
        charts = [chart for text in given.signals for chart in find_signals(opened, text)]
        target = given.out or opened.path.with_name("plot.png")
        save(str(opened.path), charts, target)
    say(f"wrote {target}")
    return ExitCode.FINISHED


def report_command(given: Report) -> int:
    """Write the page of one recording or several."""
    problems: list[str] = []
    path = write_page(given.recordings, given.out, problems, has_replay=not given.no_replay)
    for line in problems:
        print_error(line)
    say(f"wrote {path}")
    return ExitCode.FINISHED
