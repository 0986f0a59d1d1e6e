"""What a recording becomes: `stepbus export`, `plot` and `report`."""

from collections.abc import Sequence
from dataclasses import make_dataclass
from pathlib import Path
from typing import Annotated, Any

from stepbus_orchestrator.cli.info import shown_size
from stepbus_orchestrator.cli.parameters import RECORDING, File, RecordingPath, command
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


Targets: Any = make_dataclass(
    "Targets",
    [
        *(
            (name, Annotated[Path | None, {"metavar": one.metavar, "help": one.help}], None)
            for name, one in _EXPORTERS.items()
        ),
        *(
            (
                name,
                Annotated[str, {"flag": _flag(name), "metavar": metavar, "help": text}],
                "",
            )
            for name, (metavar, text) in _OPTIONS.items()
        ),
    ],
    kw_only=True,
)
"""What a recording is written as, and where; and how: what all installed exporters take."""


@command(group="look")
def export_command(recording: RecordingPath, *, targets: Targets) -> int:
    """Export a recording to other formats.

    Writes a recording as tables (CSV, Parquet), a video, a 3D scene in one HTML file, or a file for
    ROS 2, Foxglove or Rerun. A damaged recording is exported up to the damage. Exit code 8: a port
    could not be exported completely.

    $ stepbus export run.mcap --parquet tables
    $ stepbus export runs/arm --csv all.csv
    $ stepbus export runs/arm --video arm.mp4 --viewpoint front --size 1280x720
    $ stepbus export runs/arm --video arm.gif --from 2s --to 5s
    $ stepbus export runs/arm --ros2 arm.mcap
    $ stepbus export run.mcap --scene scene.html
    """
    given = vars(targets)
    paths = {form: given[form] for form in _EXPORTERS if given[form] is not None}
    options = {name: given[name] for name in _OPTIONS}
    if not paths:
        raise WiringError("nothing to export; give a target, e.g. --parquet tables")
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


@command(group="look")
def plot_command(
    recording: RecordingPath,
    signals: Annotated[Sequence[str], {"metavar": "SIGNAL"}] = (),
    *,
    out: File = None,
) -> int:
    """Plot signals of a recording.

    Draws signals of a recording over simulation time, one panel each, in one picture. A port alone
    selects all its numbers. Without a signal, lists all signals of the recording.

    signals: PARTICIPANT.PORT, with .FIELD, with [INDEX] or [JOINT] (none: list all signals). out:
    the picture: .png, .svg or .pdf (default: plot.png next to the recording).

    $ stepbus plot run.mcap controller.command plant.joint_state.position[0]
    $ stepbus plot runs/arm plant.joint_state.velocity[joint2] --out velocity.svg
    """
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


@command(group="look")
def report_command(
    recordings: Annotated[Sequence[Path], {"metavar": "RECORDING", "nargs": "+", **RECORDING}],
    *,
    out: File = None,
    no_replay: bool = False,
) -> int:
    """Write report.html for a run, or compare several runs.

    Writes one self-contained HTML file: outcome and reason, curves of the joints and of every other
    numeric port, the animated 3D scene, events and faults, step times, camera stills. Several
    recordings share their charts. `stepbus run` writes this report for each run, without the
    animated scene.

    recordings: a run.mcap, or the folder of its run; several are compared. out: the page (default:
    report.html next to the first recording). no_replay: omit the animated scene, which takes some
    seconds to write and needs the extra `view`.

    $ stepbus report runs/arm
    $ stepbus report runs/pd runs/pid --out comparison.html
    """
    problems: list[str] = []
    path = write_page(recordings, out, problems, has_replay=not no_replay)
    for line in problems:
        print_error(line)
    say(f"wrote {path}")
    return ExitCode.FINISHED
