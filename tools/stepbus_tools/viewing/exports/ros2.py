"""A recording as a bag of ROS 2: `ros2 bag`, rosbags, RViz, Foxglove and PlotJuggler read it."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from stepbus_orchestrator.recording import Recording
from stepbus_participant import need
from stepbus_tools.columns import distinct
from stepbus_tools.viewing.exports.exporter import Exported, Rate, Reached, instants, readable_ports
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.scene import Latest
from stepbus_tools.whole_file import replaced

from .frames import FrameTree
from .ros2_messages import CONVERTED, Fields, markers, stamp, transforms

_TF_HZ = 50
_STRING = "std_msgs/msg/String"
_TF = "tf2_msgs/msg/TFMessage"
_CLOCK = "/clock"
_MARKERS = "/scene"
_KEPT = ("/tf_static", _MARKERS, "robot_description")
"""Ends of topics whose last message a late subscriber gets too."""
_VERSION = 8
"""Of a bag: Humble reads it; from 9 on, the qualities of service are words."""
_FOREVER = 2147483647, 4294967295
"""Seconds and nanoseconds."""


def write(recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write the messages that ROS 2 has a type for; `CONVERTED` lists them.

    Besides: the frames as /tf, fifty times a second, and /tf_static; the robots' descriptions; what
    the scene looks like; the clock. target: an .mcap, or a folder, which becomes a bag with its
    metadata.yaml.
    """
    ports, lost = readable_ports(recording)
    scene = build_scene(recording)
    tree = FrameTree(scene, ports)
    wanted = [p for p in ports if p.type in CONVERTED or p.topic in scene.topics]
    left = [f"{p.topic} ({p.type})" for p in ports if p.type not in CONVERTED]
    # The only robot has the usual topic.
    descriptions = {robot: f"{robot.prefix}robot_description" for robot in tree.robots}
    shown = [port.topic for port in wanted if port.type in CONVERTED]
    topic_of = _topics([*shown, *descriptions.values()])
    rate, latest = Rate(_TF_HZ), dict[str, Latest]()
    is_file = target.suffix == ".mcap"
    # As `ros2 bag record` names it.
    file = target if is_file else target / f"{target.name}_0.mcap"
    paths = [file] if is_file else [file, target / "metadata.yaml"]
    with replaced(file) as part, TemporaryDirectory(dir=part.parent, prefix=".bag-") as room:
        folder = Path(room, file.stem)
        with _writer(folder) as writer:
            bag = _Bag(writer)
            for robot, name in descriptions.items():
                bag.add(topic_of[name], _STRING, {"data": robot.body.model.text}, 0)
            bag.add("/tf_static", _TF, transforms(tree.still(), 0), 0)
            if scene.has_looks:
                bag.add(_MARKERS, "visualization_msgs/msg/MarkerArray", markers(scene, tree), 0)
            for t_ns, group in instants(recording, wanted, lost, reached):
                topics = [instant.port.topic for instant in group]
                latest |= {i.port.topic: Latest(i.step, i.message) for i in group}
                if rate.passes(_CLOCK, t_ns):
                    bag.add(_CLOCK, "rosgraph_msgs/msg/Clock", {"clock": stamp(t_ns)}, t_ns)
                due = frozenset(topic for topic in topics if rate.passes(topic, t_ns))
                if moved := list(tree.moved(due, latest)):
                    bag.add("/tf", _TF, transforms(moved, t_ns), t_ns)
                for instant in group:
                    for row in CONVERTED.get(instant.port.type, ()):
                        if (fields := row.fields(tree, instant)) is not None:
                            topic = row.topic.format(topic_of[instant.port.topic])
                            bag.add(topic, row.type, fields, t_ns)
        shutil.move(folder / f"{folder.name}.mcap", part)
        for about in paths[1:]:
            with replaced(about) as metadata:
                shutil.move(folder / about.name, metadata)
    unknown = [f"ROS 2 has no type for {', '.join(left)}: not exported"] if left else []
    renamed = [f"{old} is {new}" for old, new in topic_of.items() if new != f"/{old}"]
    legal = [f"topics as ROS 2 allows them: {', '.join(renamed)}"] if renamed else []
    problems = [*scene.notes, *unknown, *legal, *lost.values()]
    return Exported(paths=paths, problems=problems, lost=list(lost))


def _topics(names: Sequence[str]) -> dict[str, str]:
    """Return name → its topic in ROS 2: letters, digits and `_`, and no part begins with a digit.

    Each has another one, and a legal name keeps its own.
    """
    legal = {
        n: re.sub(r"/(?=[0-9])", "/_", re.sub(r"[^\w/]", "_", f"/{n}", flags=re.ASCII))
        for n in names
    }
    order = sorted(legal, key=lambda name: legal[name] != f"/{name}")
    return dict(zip(order, distinct([legal[name] for name in order]), strict=True))


def _writer(folder: Path) -> Any:
    """Return what writes a bag to a new folder."""
    (bags,) = need("the export for ROS 2", "rosbags.rosbag2")
    writer = bags.Writer(folder, version=_VERSION, storage_plugin=bags.StoragePlugin.MCAP)
    writer.set_compression(bags.CompressionMode.STORAGE, bags.CompressionFormat.ZSTD)
    return writer


class _Bag:
    """The messages of a bag; a topic is added when its first one comes."""

    def __init__(self, writer: Any) -> None:
        typesys, self._forms = need("the export for ROS 2", "rosbags.typesys", "rosbags.interfaces")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._kinds = self._forms.Nodetype
        self._writer = writer
        self._topics: dict[str, Any] = {}

    def add(self, topic: str, type_name: str, fields: Fields, t_ns: int) -> None:
        """Write a message, of nested maps; what is left out is zero or empty. t_ns: [ns]."""
        if topic not in self._topics:
            quality = [self._quality(is_kept=topic.endswith(_KEPT))]
            self._topics[topic] = self._writer.add_connection(
                topic, type_name, typestore=self._store, offered_qos_profiles=quality
            )
        data = self._store.serialize_cdr(self._message(type_name, fields), type_name)
        self._writer.write(self._topics[topic], t_ns, data)

    def _quality(self, *, is_kept: bool) -> Any:
        """Return the quality of service that a topic's publisher offers."""
        forms = self._forms
        forever = forms.QosTime(*_FOREVER)
        durability = forms.QosDurability
        return forms.Qos(
            history=forms.QosHistory.KEEP_LAST,
            depth=1 if is_kept else 10,
            reliability=forms.QosReliability.RELIABLE,
            durability=durability.TRANSIENT_LOCAL if is_kept else durability.VOLATILE,
            deadline=forever,
            lifespan=forever,
            liveliness=forms.QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=forever,
            avoid_ros_namespace_conventions=False,
        )

    def _message(self, type_name: str, fields: Fields) -> Any:
        _, kinds = self._store.fielddefs[type_name]
        values = {name: self._value(kind, fields.get(name)) for name, kind in kinds}
        return self._store.types[type_name](**values)

    def _value(self, kind: Any, value: Any) -> Any:
        form, what = kind
        if form == self._kinds.NAME:
            return self._message(what, value or {})
        if form == self._kinds.BASE:
            empty = "" if what[0] == "string" else 0
            return empty if value is None else value
        (inner, name), count = what
        if inner == self._kinds.NAME:
            return [self._message(name, one) for one in value or ()]
        if name[0] == "string":
            return value or []
        return np.zeros(count, name[0]) if value is None else np.asarray(value, name[0])
