"""The forms that a recording is exported to, found by entry points.

They are declared apart from what writes them, so that the help of `stepbus export` loads nothing.
"""

import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from stepbus_orchestrator.plugins import named_points
from stepbus_schemas import WiringError

EXPORTS = "stepbus.exports"
"""The group of entry points: name of a form → its `Exporter`."""
_TABLES = "tables: a folder with one file per port, or a .{} file with one row per value"
_VIEWPOINT = (
    "camera position for the scene: corner, front, left, right, above, or X,Y,Z[:X,Y,Z] [m] "
    "(position, and the point it looks at)"
)
_IN = "stepbus_tools.viewing.exports"


@dataclass(frozen=True, kw_only=True)
class Exporter:
    """A form of export."""

    write: str
    """`module:function`, which takes the recording, the target, what is told the step that is
    reached, and its options by name; returns an `Exported`, and raises as `export`."""
    help: str
    """Help of its option of `stepbus export`."""
    metavar: str = "FILE"
    options: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Name of a further option → the name of its value and its help, without its form."""

    def load(self) -> Callable[..., Any]:
        """Return the function that writes; raises WiringError where it cannot be loaded."""
        try:
            function: Callable[..., Any] = pkgutil.resolve_name(self.write)
        except (ImportError, AttributeError) as exc:
            raise WiringError(f"the exporter {self.write} cannot be loaded: {exc}") from exc
        return function


def exporters() -> dict[str, Exporter]:
    """Return form → its exporter; raises WiringError for one that cannot be loaded."""
    known: dict[str, Exporter] = {}
    for name, point in named_points(EXPORTS).items():
        try:
            known[name] = point.load()
        except (ImportError, AttributeError) as exc:
            why = f"the exporter {name!r} cannot be loaded from {point.value}: {exc}"
            raise WiringError(why) from exc
    return known


CSV = Exporter(write=f"{_IN}.tables:write_csv", help=_TABLES.format("csv"), metavar="PATH")
PARQUET = Exporter(
    write=f"{_IN}.tables:write_parquet", help=_TABLES.format("parquet"), metavar="PATH"
)
FOXGLOVE = Exporter(
    write=f"{_IN}.ros2:write", help="the file of --ros2, which Foxglove and Lichtblick open"
)
RERUN = Exporter(
    write=f"{_IN}.rerun_file:write",
    help="an .rrd for Rerun: animated scene, curves, events, images",
)
ROS2 = Exporter(
    write=f"{_IN}.ros2:write",
    help="a ROS 2 bag of all ports with a ROS 2 type: an .mcap, or a folder with metadata.yaml",
    metavar="PATH",
)
SCENE = Exporter(
    write=f"{_IN}.scene_file:write",
    help="animated robot and world with a time slider: one self-contained HTML file",
)
VIDEO = Exporter(
    write=f"{_IN}.video:write",
    help=".mp4 or .gif of the recorded camera, or of the 3D scene if there is none",
    options={
        "camera": ("PORT", "image port; default: the first with at least one image per second"),
        "viewpoint": ("FROM", _VIEWPOINT),
        "size": ("WxH", "image size in pixels; default: 640x480, or that of the camera"),
        "fps": ("N", "frames per second; default: 25, or every camera image"),
        "from_": ("T", "simulation time of the first frame, e.g. 2s"),
        "to": ("T", "simulation time of the last frame"),
    },
)
