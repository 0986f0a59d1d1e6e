#!/usr/bin/env bash
# mcap: with reverse=True, messages of one time come in another order from a stream than from a file that can seek.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap==1.6.0
cat > "$folder/read.py" <<'PYTHON'
import io
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.writer import Writer

file = io.BytesIO()
writer = Writer(file)
writer.start()
channel = writer.register_channel("state", "x", 0)
for time, name in ((5, b"1"), (3, b"2"), (5, b"3"), (3, b"4")):
    writer.add_message(channel, time, name, time)
writer.finish()
for reader in (SeekingReader, NonSeekingReader):
    for options in ({}, {"reverse": True}, {"reverse": True, "log_time_order": False}):
        try:
            messages = reader(io.BytesIO(file.getvalue())).iter_messages(**options)
            seen = "".join(message.data.decode() for _, _, message in messages)
        except ValueError:
            seen = "ValueError"
        print(reader.__name__, options, seen)
PYTHON
"$folder/venv/bin/python" "$folder/read.py" > "$folder/seen"
echo "mcap 1.6.0"
echo "guess: reverse is the order of the file turned round, 3142, by either reader"
echo "seen:  a stream keeps the order within a time, 1324, and where order by time is off it ignores reverse:"
cat "$folder/seen"
cat > "$folder/expected" <<'SEEN'
SeekingReader {} 2413
SeekingReader {'reverse': True} 3142
SeekingReader {'reverse': True, 'log_time_order': False} ValueError
NonSeekingReader {} 2413
NonSeekingReader {'reverse': True} 1324
NonSeekingReader {'reverse': True, 'log_time_order': False} 1234
SEEN
cmp "$folder/expected" "$folder/seen"
