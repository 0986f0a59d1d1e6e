"""What a recording becomes: `stepbus export`, `plot` and `report`."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from stepbus_orchestrator.cli.parameters import (
    File,
    command,
    later,
)


@command(
    group="look",
    execute="stepbus_tools.commands.exporting:export_command",
    options={"targets": later("stepbus_tools.commands.exporting:targets")},
)
def export_command(recording: Path, /, *, targets: Any = None) -> None:
    """Export a recording to other formats.

    Writes a recording as tables (CSV, Parquet), a video, a 3D scene in one HTML file, or a file for
    ROS 2, Foxglove or Rerun. A damaged recording is exported up to the damage. Exit code 8: a port
    could not be exported completely.

    Parameters
    ----------
    recording
        a run.mcap, or the folder of its run
    targets
        what the recording is written as

    Examples
    --------
    $ stepbus export run.mcap --parquet tables
    $ stepbus export runs/arm --csv all.csv
    $ stepbus export runs/arm --video arm.mp4 --viewpoint front --size 1280x720
    $ stepbus export runs/arm --video arm.gif --from 2s --to 5s
    $ stepbus export runs/arm --ros2 arm.mcap
    $ stepbus export run.mcap --scene scene.html

    """


@command(group="look", execute="stepbus_tools.commands.exporting:plot_command")
def plot_command(
    recording: Path,
    /,
    *signals: Annotated[str, Parameter(name="SIGNAL")],
    out: File = None,
) -> None:
    """Plot signals of a recording.

    Draws signals of a recording over simulation time, one panel each, in one picture. A port alone
    selects all its numbers. Without a signal, lists all signals of the recording.

    Parameters
    ----------
    recording
        a run.mcap, or the folder of its run
    signals
        PARTICIPANT.PORT, with .FIELD, with [INDEX] or [JOINT] (none: list all signals)
    out
        the picture: .png, .svg or .pdf (default: plot.png next to the recording)

    Examples
    --------
    $ stepbus plot run.mcap controller.command plant.joint_state.position[0]
    $ stepbus plot runs/arm plant.joint_state.velocity[joint2] --out velocity.svg

    """


@command(group="look", execute="stepbus_tools.commands.exporting:report_command")
def report_command(
    recording: Path,
    /,
    *others: Annotated[Path, Parameter(name="RECORDING")],
    out: File = None,
    no_replay: bool = False,
) -> None:
    """Write report.html for a run, or compare several runs.

    Writes one self-contained HTML file: outcome and reason, curves of the joints and of every other
    numeric port, the animated 3D scene, events and faults, step times, camera stills. Several
    recordings share their charts. `stepbus run` writes this report for each run, without the
    animated scene.

    Parameters
    ----------
    recording
        a run.mcap, or the folder of its run; several are compared
    others
        further recordings
    out
        the page (default: report.html next to the first recording)
    no_replay
        omit the animated scene, which takes some seconds to write and needs the extra `view`

    Examples
    --------
    $ stepbus report runs/arm
    $ stepbus report runs/pd runs/pid --out comparison.html

    """
