"""A recording as a bag of ROS 2: `ros2 bag`, rosbags, RViz, Foxglove and PlotJuggler read it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from textwrap import indent
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording
from stepbus_participant import need
from stepbus_tools.columns import distinct
from stepbus_tools.viewing.exports.exporter import Exported, Exporter, Reached
from stepbus_tools.viewing.scene.bodies import Latest
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.whole_file import replaced

from .frames import FrameTree
from .instants import Rate, instants, readable_ports
from .ros2_messages import CONVERTED, Fields, markers, stamp, transforms

_TF_HZ = 50
_STRING = "std_msgs/msg/String"
_TF = "tf2_msgs/msg/TFMessage"
_CLOCK = "/clock"
_MARKERS = "/scene"
_KEPT = ("/tf_static", _MARKERS, "robot_description")
"""Ends of topics whose last message a late subscriber gets too."""
_RELIABLE, _TRANSIENT_LOCAL, _VOLATILE, _KEEP_LAST, _AUTOMATIC = 1, 1, 2, 1, 1
"""Qualities of service, as metadata up to version 8 has them; later versions have words."""
_METADATA_VERSION = 5
"""The newest that Humble reads."""
_FOREVER = "{sec: 2147483647, nsec: 4294967295}"


def _export(recording: Recording, target: Path, reached: Reached) -> Exported:
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
    with _files(target) as (path, about):
        with path.open("wb") as stream:
            bag = _Bag(stream, _mcap_name(target))
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
            metadata = bag.close()
        if about is not None:
            lines = indent(metadata, "  ")
            about.write_text(f"rosbag2_bagfile_information:\n{lines}", encoding="utf-8")
    unknown = [f"ROS 2 has no type for {', '.join(left)}: not exported"] if left else []
    renamed = [f"{old} is {new}" for old, new in topic_of.items() if new != f"/{old}"]
    legal = [f"topics as ROS 2 allows them: {', '.join(renamed)}"] if renamed else []
    problems = [*scene.notes, *unknown, *legal, *lost.values()]
    paths = [target] if about is None else [target / _mcap_name(target), target / _ABOUT]
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


ROS2 = Exporter(
    write=_export,
    help="a ROS 2 bag of all ports with a ROS 2 type: an .mcap, or a folder with metadata.yaml",
    metavar="PATH",
)

_ABOUT = "metadata.yaml"


def _mcap_name(target: Path) -> str:
    """Return the name of the file with the messages, as `ros2 bag record` gives it."""
    return target.name if target.suffix == ".mcap" else f"{target.name}_0.mcap"


@contextmanager
def _files(target: Path) -> Iterator[tuple[Path, Path | None]]:
    """Yield where the messages go, and the metadata; None where the target is a single file."""
    if target.suffix == ".mcap":
        with replaced(target) as path:
            yield path, None
        return
    if target.exists() and not target.is_dir():
        raise RecordingFailed(f"{target} is not a folder; write .mcap for a single file")
    with replaced(target / _mcap_name(target)) as path, replaced(target / _ABOUT) as about:
        yield path, about


class _Bag:
    """The file. Channels are added when their first message comes. name: of the file."""

    def __init__(self, stream: Any, name: str) -> None:
        typesys, interfaces = need("the export for ROS 2", "rosbags.typesys", "rosbags.interfaces")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._kinds = interfaces.Nodetype
        self._writer: Any = Writer(stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="stepbus")
        self._name = name
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._types: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self._end_ns = 0

    def add(self, topic: str, type_name: str, fields: Fields, t_ns: int) -> None:
        """Write a message, of nested maps; what is left out is zero or empty. t_ns: [ns]."""
        if topic not in self._channels:
            self._channels[topic] = self._channel(topic, type_name)
        count = self._counts[topic] = self._counts.get(topic, 0) + 1
        self._end_ns = max(self._end_ns, t_ns)
        data = bytes(self._store.serialize_cdr(self._message(type_name, fields), type_name))
        self._writer.add_message(self._channels[topic], t_ns, data, t_ns, count - 1)

    def _channel(self, topic: str, type_name: str) -> int:
        if type_name not in self._schemas:
            text, _ = self._store.generate_msgdef(type_name, ros_version=2)
            definition = str(text).encode()
            schema = self._writer.register_schema(type_name, "ros2msg", definition)
            self._schemas[type_name] = schema
        metadata = {"offered_qos_profiles": _qos(topic)}
        schema = self._schemas[type_name]
        self._types[topic] = type_name
        number: int = self._writer.register_channel(topic, "cdr", schema, metadata)
        return number

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

    def close(self) -> str:
        """End the file; return its metadata, which is in it too."""
        text = self._metadata()
        # From Jazzy on, rosbag2 learns from it in which way the qualities of service are written.
        self._writer.add_metadata("rosbag2", {"serialized_metadata": text})
        self._writer.finish()
        return text

    def _metadata(self) -> str:
        """Return what rosbag2 writes into metadata.yaml, below its first line."""
        from ruamel.yaml import YAML  # noqa: PLC0415  (a tenth of a second)

        span = {
            "duration": {"nanoseconds": self._end_ns},
            "starting_time": {"nanoseconds_since_epoch": 0},
            "message_count": sum(self._counts.values()),
        }
        content: Mapping[str, Any] = {
            "version": _METADATA_VERSION,
            "storage_identifier": "mcap",
            **span,
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic,
                        "type": self._types[topic],
                        "serialization_format": "cdr",
                        "offered_qos_profiles": _qos(topic),
                    },
                    "message_count": count,
                }
                for topic, count in self._counts.items()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._name],
            "files": [{"path": self._name, **span}],
        }
        yaml, stream = YAML(typ="safe"), StringIO()
        yaml.default_flow_style = False
        yaml.representer.ignore_aliases = lambda _: True
        yaml.dump(content, stream)
        return stream.getvalue()


def _qos(topic: str) -> str:
    """Return the quality of service that a topic's publisher offers."""
    is_kept = topic.endswith(_KEPT)
    return (
        f"- history: {_KEEP_LAST}\n"
        f"  depth: {1 if is_kept else 10}\n"
        f"  reliability: {_RELIABLE}\n"
        f"  durability: {_TRANSIENT_LOCAL if is_kept else _VOLATILE}\n"
        f"  deadline: {_FOREVER}\n"
        f"  lifespan: {_FOREVER}\n"
        f"  liveliness: {_AUTOMATIC}\n"
        f"  liveliness_lease_duration: {_FOREVER}\n"
        "  avoid_ros_namespace_conventions: false\n"
    )
