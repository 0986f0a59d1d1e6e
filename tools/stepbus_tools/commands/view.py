"""`stepbus view`: a recording, or a live run, in the browser or in Foxglove."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from stepbus_orchestrator.cli.parameters import (
    GROUP,
    FoxglovePort,
    PortNumber,
    command,
)


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a recording is shown.

    Attributes
    ----------
    port
        port to listen on (default: any free port)
    host
        address to listen on (default: this machine only)
    no_open
        do not open a browser
    foxglove
        serve Foxglove and Lichtblick over a WebSocket instead of the page (default: any free port)

    """

    port: PortNumber = None
    host: str = "127.0.0.1"
    no_open: bool = False
    foxglove: FoxglovePort = None


_HERE = Place()


@command(
    group="look",
    execute="stepbus_tools.commands.viewing:view_command",
    bare={"--foxglove": "0"},
)
def view_command(
    recording: Path,
    ghost: Path | None = None,
    /,
    *,
    follow: bool = False,
    until_end: bool = False,
    place: Annotated[Place, GROUP] = _HERE,
) -> None:
    """Show a recording or a live run in 3D, in the browser.

    Serves a local page with the robot and world of a recording: targets as ghosts, contacts,
    planned paths, detections, camera images, curves and events, with a time slider. It reads only
    what you look at, so a long recording opens immediately. The URL contains a token and works
    once, in one browser.

    Parameters
    ----------
    recording
        a run.mcap, or the folder of its run, which may be live
    ghost
        a second recording, drawn as a ghost
    follow
        wait for a run to start in this folder
    until_end
        exit when the run ends, instead of showing its recording
    place
        where the recording is shown

    Examples
    --------
    $ stepbus view runs/arm
    $ stepbus view runs/arm/run.mcap runs/other/run.mcap --no-open
    $ stepbus view runs/arm --foxglove 8765

    """
