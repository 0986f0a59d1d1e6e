#!/usr/bin/env bash
# rosbags: the end of a bag is a nanosecond after its last message, so one message lasts 1 ns; a bag without messages begins in the year 2262 and ends in 1970, with a duration of 0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9 numpy==2.4.6
cat > "$folder/run.py" <<'PYTHON'
import sys

from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

NAME = "std_msgs/msg/Int32"


def span(writer, reader, store, serialize, times):
    """Return start, end and duration of a bag with messages at these times [ns]."""
    with writer:
        topic = writer.add_connection("/a", NAME, typestore=store)
        for time in times:
            writer.write(topic, time, serialize(store.types[NAME](0), NAME))
    with reader() as bag:
        return bag.start_time, bag.end_time, bag.duration


one, two = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
with open(sys.argv[1], "w") as seen:
    for times in ([], [100], [100, 200]):
        name = f"bag{len(times)}"
        of_one = rosbag1.Writer(f"{name}.bag"), lambda: rosbag1.Reader(f"{name}.bag"), one, one.serialize_ros1
        of_two = rosbag2.Writer(name, version=9), lambda: rosbag2.Reader(name), two, two.serialize_cdr
        print("ROS 1", times, *span(*of_one, times), file=seen)
        print("ROS 2", times, *span(*of_two, times), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen
echo "rosbags 0.11.9: times of the messages; start, end and duration of the bag [ns]"
echo "guess: 0 0 0, or an error; 100 100 0; 100 200 100"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
ROS 1 [] 9223372036854775807 0 0
ROS 2 [] 9223372036854775807 0 0
ROS 1 [100] 100 101 1
ROS 2 [100] 100 101 1
ROS 1 [100, 200] 100 201 101
ROS 2 [100, 200] 100 201 101
SEEN
