"""A recording for Foxglove and Lichtblick: foxglove.* messages at 30 Hz, and a layout."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_tools.columns import fields_of
from stepbus_tools.viewing.exports.exporter import Exported, Exporter, Reached
from stepbus_tools.viewing.foxglove import PER_S, SHOWN, WORLD, Channels, Conversion, topic_of
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.scene.bodies import Latest
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.swept import Swept, swept
from stepbus_tools.viewing.viewpoint import clear_corner
from stepbus_tools.whole_file import replaced

from .instants import NS, Rate, instants, readable_ports

_PLOTTED = ("position", "velocity")
_MOST_PATHS = 20


def _export(recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write joints, the scene and its frames, images and events; and a layout beside it.

    The layout has the name of the target, with the ending .layout.json.
    """
    ports, lost = readable_ports(recording)
    scene, history = build_scene(recording), History(recording)
    wanted = [p for p in ports if p.type in SHOWN or p.topic in scene.topics]
    layout = target.with_suffix(".layout.json")
    rate, latest, due_ns = Rate(PER_S), dict[str, Latest](), 0
    with replaced(target) as path, _opened(path, target) as channels:
        conversion = Conversion(scene, channels)
        conversion.place({frame.name: frame.pose for frame in scene.frames}, 0)
        conversion.bodies()
        for t_ns, group in instants(recording, wanted, lost, reached):
            moving = [i for i in group if i.port.topic in scene.topics]
            latest |= {i.port.topic: Latest(i.step, i.message) for i in moving}
            if moving and t_ns >= due_ns:
                due_ns = t_ns + round(NS / PER_S)
                conversion.place(scene.poses(latest), t_ns)
            for instant in group:
                if instant.port.type == "Event/1" or rate.passes(instant.port.topic, t_ns):
                    conversion.take(instant.port, instant.message, t_ns)
    with replaced(layout) as path:
        text = json.dumps(_layout(swept(scene, history), wanted), indent=2)
        path.write_text(text + "\n", encoding="utf-8")
    problems = [*scene.notes, *lost.values()]
    return Exported(paths=[target, layout], problems=problems, lost=list(lost))


FOXGLOVE = Exporter(
    write=_export, help="an .mcap for Foxglove and Lichtblick, at 30 Hz, with a layout file"
)


@contextmanager
def _opened(path: Path, target: Path) -> Iterator[Channels]:
    """Open a file, and yield what writes into it. The library says at its end whether it could."""
    channels = Channels()
    writer = channels.foxglove.open_mcap(path, allow_overwrite=True, context=channels.context)
    try:
        yield channels
    except BaseException:
        with suppress(RuntimeError):
            writer.close()
        raise
    try:
        writer.close()
    except RuntimeError as exc:
        raise RecordingFailed(f"{target} cannot be written; is the disk full? ({exc})") from exc


def _layout(shown: Swept, ports: Sequence[Port]) -> Mapping[str, Any]:
    """Return a layout: the scene beside joints over time with their units, images, the log.

    shown: what moves in the scene.
    """
    images = [port for port in ports if port.type == "Image/1"]
    panels: dict[str, Mapping[str, Any]] = {
        f"Plot!{name}": panel for name in _PLOTTED if (panel := _plot(ports, name))
    }
    if images:
        panels["Image!camera"] = {"imageMode": {"imageTopic": topic_of(images[0])}}
    panels["RosOut!log"] = {"topicToRender": "/log", "minLogLevel": 1, **_titled("events")}
    *above, last = panels
    column: Any = last
    for number, name in enumerate(reversed(above)):
        # As much for each: the rest is as many panels as there are.
        share = 100 / (number + 2)
        column = {
            "direction": "column", "first": name, "second": column, "splitPercentage": share,
        }  # fmt: skip
    return {
        "configById": {"3D!scene": _scene_panel(shown), **panels},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row", "first": "3D!scene", "second": column, "splitPercentage": 60,
        },
    }  # fmt: skip


def _titled(title: str) -> dict[str, str]:
    """Return the title of a panel, as Foxglove and Lichtblick spell it."""
    return dict.fromkeys(("foxglovePanelTitle", "lichtblickPanelTitle"), title)


def _plot(ports: Sequence[Port], quantity: str) -> Mapping[str, Any]:
    """Return a panel of a quantity of all measured joints; empty where there are none."""
    paths, units = [], dict[str, None]()
    for port in ports:
        if port.type != "JointState/1":
            continue
        columns = {
            column.name: column.unit
            for field in fields_of(port, port.message_class)
            if field.name == quantity
            for column in field.columns
        }
        for index, name in enumerate(port.names):
            unit = columns.get(f"{quantity}.{name}", "")
            units[unit] = None
            paths.append(
                {
                    "value": f"{topic_of(port)}.joints[{index}].{quantity}",
                    "label": name,
                    "enabled": True,
                    "timestampMethod": "receiveTime",
                }
            )
    if not paths:
        return {}
    unit = ", ".join(units)
    title = f"{quantity} [{unit}]"
    return {
        "paths": paths[:_MOST_PATHS],
        "title": title,
        **_titled(title),
        "yAxisLabel": unit,
        "xAxisLabel": "time [s]",
        "xAxisVal": "timestamp",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "left",
        "showPlotValuesInLegend": False,
        "isSynced": True,
        "sidebarDimension": 220,
    }


def _scene_panel(shown: Swept) -> Mapping[str, Any]:
    """Return a 3D panel that shows the whole scene, on a floor, without the names of its frames."""
    low, high = shown.box
    # Foxglove turns its camera about z, away from −y.
    x, y, _ = clear_corner(shown.box, shown.fixed)
    size = float(np.linalg.norm(high - low))
    middle = ((low + high) / 2).tolist()
    side = max(3, math.ceil(1.5 * size))
    return {
        "followTf": WORLD,
        "followMode": "follow-none",
        "cameraState": {
            "distance": 1.45 * size,
            "perspective": True,
            "phi": 65,
            "thetaOffset": math.degrees(math.atan2(-x, -y)),
            "target": middle,
            "targetOffset": middle,
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.01,
            "far": 1000,
        },
        "topics": {"/scene": {"visible": True}},
        "transforms": {},
        "scene": {
            "transforms": {
                "showLabel": False,
                "axisScale": 0,
                "lineWidth": 0,
                # Without it, Lichtblick warns that frames may be wrong after a jump in time.
                "enablePreloading": True,
            }
        },
        "layers": {
            "floor": {
                "layerId": "foxglove.Grid",
                "instanceId": "floor",
                "label": "floor",
                "visible": True,
                "frameId": WORLD,
                "frameLocked": True,
                "size": side,
                "divisions": 2 * side,
                "lineWidth": 1,
                "color": "#8a8f98",
                "position": [middle[0], middle[1], min(0.0, float(low[2]))],
                "rotation": [0, 0, 0],
                "order": 1,
            }
        },
    }
