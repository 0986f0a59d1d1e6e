#!/usr/bin/env bash
# mcap: messages at the end time of a reading are left out by the Python reader and given by the JavaScript one.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap==1.6.0
cat > "$folder/try.py" <<'PYTHON'
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

with open("log.mcap", "wb") as file:
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start()
    channel = writer.register_channel("t", "json", writer.register_schema("a", "jsonschema", b"{}"))
    for time in range(5):
        writer.add_message(channel, time, b"{}", time)
    writer.finish()
with open("log.mcap", "rb") as file:
    read = make_reader(file).iter_messages(start_time=1, end_time=3)
    print("Python", *(message.log_time for _, _, message in read))
PYTHON
cat > "$folder/try.mjs" <<'JAVASCRIPT'
import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { open } from "node:fs/promises";

const readable = new FileHandleReadable(await open("log.mcap"));
const reader = await McapIndexedReader.Initialize({ readable });
const times = [];
for await (const message of reader.readMessages({ startTime: 1n, endTime: 3n })) times.push(message.logTime);
console.log("JavaScript", times.join(" "));
JAVASCRIPT
cd "$folder"
npm install --silent --no-audit --no-fund @mcap/core@2.2.2 @mcap/nodejs@1.0.2 >/dev/null
{ venv/bin/python -W ignore try.py && node try.mjs; } | tee seen
echo "mcap 1.6.0 (Python), @mcap/core 2.2.2 (Node.js): the messages from 1 to 3"
echo "guess: 1 2 3 in both"
echo "seen:  1 2 in Python, 1 2 3 in JavaScript; since 1.6.0 Python deprecates the words start_time and end_time for this"
printf 'Python 1 2\nJavaScript 1 2 3\n' | cmp - seen
