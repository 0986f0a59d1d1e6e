#!/usr/bin/env bash
# mcap-ros2-support: the writer takes a message with a field that the type does not have, and writes the default in its place.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap==1.6.0 mcap-ros2-support==0.6.0
cat > "$folder/run.py" <<'PYTHON'
import io
import json
import sys

from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer

file = io.BytesIO()
writer = Writer(file)
schema = writer.register_msgdef("robot/msg/Wheel", "float64 velocity")
wrong = {"velocty": 3.0}
writer.write_message("/wheel", schema, wrong, log_time=1, publish_time=1)
writer.finish()
file.seek(0)
(message,) = read_ros2_messages(file)
with open(sys.argv[1], "w") as seen:
    print(f"written {json.dumps(wrong)}, read velocity {message.ros_msg.velocity}", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "mcap-ros2-support 0.6.0"
echo "guess: an unknown key of the message is refused"
echo "seen:"
cat seen
printf 'written {"velocty": 3.0}, read velocity 0.0\n' | cmp - seen
