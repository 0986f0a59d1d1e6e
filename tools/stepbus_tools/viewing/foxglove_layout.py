"""A layout for Foxglove and Lichtblick: the scene beside the joints' positions, images, the log."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from stepbus_orchestrator.recording import PortInfo
from stepbus_tools.viewing.foxglove_conversion import WORLD, topic_of
from stepbus_tools.viewing.scene import Messages, Scene, bounds


def layout_of(scene: Scene, messages: Messages, ports: Sequence[PortInfo]) -> Mapping[str, Any]:
    """Return the layout of what a scene and ports are converted to. messages: place the scene."""
    joints = [port for port in ports if port.type == "JointState/1"]
    images = [port for port in ports if port.type == "Image/1"]
    paths = [
        {
            "value": f"{topic_of(port)}.joints[{index}].position",
            "label": name,
            "enabled": True,
            "timestampMethod": "receiveTime",
        }
        for port in joints
        for index, name in enumerate(port.names)
    ]
    panels: dict[str, Mapping[str, Any]] = {}
    if paths:
        panels["Plot!joints"] = {
            "paths": paths[:20],
            "title": "position [rad]",
            "showLegend": True,
            "legendDisplay": "left",
            "sidebarDimension": 170,
        }
    if images:
        panels["Image!camera"] = {"imageMode": {"imageTopic": topic_of(images[0])}}
    panels["RosOut!log"] = {"topicToRender": "/log"}
    *above, column = cast("list[Any]", list(panels))
    for name in reversed(above):
        column = {"direction": "column", "first": name, "second": column}
    return {
        "configById": {"3D!scene": _view(scene, messages), **panels},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row", "first": "3D!scene", "second": column, "splitPercentage": 60,
        },
    }  # fmt: skip


def _view(scene: Scene, messages: Messages) -> Mapping[str, Any]:
    """Return a 3D panel that shows the whole scene, on a floor, without the names of its frames."""
    low, high = bounds(scene, messages)
    size = float(np.linalg.norm(high - low))
    middle = ((low + high) / 2).tolist()
    side = max(3, math.ceil(1.5 * size))
    return {
        "followTf": WORLD,
        "followMode": "follow-none",
        "cameraState": {
            "distance": 1.3 * size,
            "perspective": True,
            "phi": 65,
            "thetaOffset": 45,
            "target": middle,
            "targetOffset": middle,
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.01,
            "far": 1000,
        },
        "topics": {"/scene": {"visible": True}},
        "transforms": {},
        "scene": {"transforms": {"showLabel": False, "axisScale": 0, "lineWidth": 0}},
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
