#!/usr/bin/env bash
# rosbags: messages of one time come back in the order in which they were written from a ROS 2 bag, and topic by topic from a ROS 1 bag.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9 numpy==2.4.6
cat > "$folder/run.py" <<'PYTHON'
import sys

from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

NAME, ORDER = "std_msgs/msg/Int32", "baba"


def order(writer, reader, store, serialize, deserialize):
    """Return topics and numbers of messages of one time that are written as b0 a1 b2 a3."""
    with writer:
        topics = {name: writer.add_connection(f"/{name}", NAME, typestore=store) for name in "ab"}
        for number, name in enumerate(ORDER):
            writer.write(topics[name], 5, serialize(store.types[NAME](number), NAME))
    with reader() as bag:
        return [f"{c.topic[1:]}{deserialize(raw, NAME).data}" for c, _, raw in bag.messages()]


with open(sys.argv[1], "w") as seen:
    store = get_typestore(Stores.ROS1_NOETIC)
    codec = store.serialize_ros1, store.deserialize_ros1
    print("ROS 1:", *order(rosbag1.Writer("one.bag"), lambda: rosbag1.Reader("one.bag"), store, *codec), file=seen)
    store = get_typestore(Stores.ROS2_JAZZY)
    codec = store.serialize_cdr, store.deserialize_cdr
    for plugin in (rosbag2.StoragePlugin.SQLITE3, rosbag2.StoragePlugin.MCAP):
        name = plugin.name.lower()
        writer = rosbag2.Writer(name, version=9, storage_plugin=plugin)
        print(f"ROS 2, {name}:", *order(writer, lambda: rosbag2.Reader(name), store, *codec), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen
echo "rosbags 0.11.9: messages of one time, written as b0 a1 b2 a3"
echo "guess: b0 a1 b2 a3 from each"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
ROS 1: a1 a3 b0 b2
ROS 2, sqlite3: b0 a1 b2 a3
ROS 2, mcap: b0 a1 b2 a3
SEEN
