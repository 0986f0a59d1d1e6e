#!/usr/bin/env bash
# mcap: a file without chunks, or without their index, has no messages and no error for the indexed reader of JavaScript; Python's reader goes through such a file from its beginning.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap==1.6.0
cat > "$folder/try.py" <<'PYTHON'
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

KINDS = {
    "chunks": {},
    "no_chunks": {"use_chunking": False},
    "no_index": {"index_types": IndexType.NONE},
}
for name, options in KINDS.items():
    with open(f"{name}.mcap", "wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, **options)
        writer.start()
        channel = writer.register_channel("t", "json", writer.register_schema("a", "jsonschema", b"{}"))
        for time in range(5):
            writer.add_message(channel, time, b"{}", time)
        writer.finish()
    with open(f"{name}.mcap", "rb") as file:
        reader = make_reader(file)
        told = reader.get_summary().statistics.message_count
        print(f"Python {name}: {told} counted, {len(list(reader.iter_messages()))} read")
PYTHON
cat > "$folder/try.mjs" <<'JAVASCRIPT'
import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { open } from "node:fs/promises";

for (const name of ["chunks", "no_chunks", "no_index"]) {
  const readable = new FileHandleReadable(await open(`${name}.mcap`));
  const reader = await McapIndexedReader.Initialize({ readable });
  let read = 0;
  for await (const _ of reader.readMessages()) read += 1;
  console.log(`JavaScript ${name}: ${reader.statistics.messageCount} counted, ${read} read`);
}
process.exit();
JAVASCRIPT
cd "$folder"
npm install --silent --no-audit --no-fund @mcap/core@2.2.2 @mcap/nodejs@1.0.2 >/dev/null
{ venv/bin/python -W ignore try.py && node try.mjs; } > seen
echo "mcap 1.6.0 (Python), @mcap/core 2.2.2 (Node.js): messages that the statistics count, and that come"
echo "guess: all 5 come, or the reader says that the file has no index"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
Python chunks: 5 counted, 5 read
Python no_chunks: 5 counted, 5 read
Python no_index: 5 counted, 5 read
JavaScript chunks: 5 counted, 5 read
JavaScript no_chunks: 5 counted, 0 read
JavaScript no_index: 5 counted, 0 read
SEEN
