#!/usr/bin/env bash
# mcap: of a chunk with one changed byte, the readers of Python and Rust give the changed message as it is; that of JavaScript says that the checksum is wrong.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap==1.6.0
cat > "$folder/try.py" <<'PYTHON'
from mcap.reader import make_reader
from mcap.stream_reader import CRCValidationError
from mcap.writer import CompressionType, Writer

with open("log.mcap", "wb") as file:
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start()
    channel = writer.register_channel("t", "json", writer.register_schema("a", "jsonschema", b"{}"))
    writer.add_message(channel, 0, b'{"position": 1}', 0)
    writer.finish()
with open("log.mcap", "rb") as file:
    content = file.read()
with open("log.mcap", "wb") as file:
    file.write(content.replace(b'"position": 1', b'"position": 9'))
for options in ({}, {"validate_crcs": True}):
    with open("log.mcap", "rb") as file:
        try:
            seen = next(make_reader(file, **options).iter_messages())[2].data.decode()
        except CRCValidationError as exc:
            seen = type(exc).__name__
    print("Python", *options, seen)
PYTHON
cat > "$folder/try.mjs" <<'JAVASCRIPT'
import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { open } from "node:fs/promises";

const readable = new FileHandleReadable(await open("log.mcap"));
const reader = await McapIndexedReader.Initialize({ readable });
try {
  for await (const { data } of reader.readMessages()) console.log("JavaScript", new TextDecoder().decode(data));
} catch (error) {
  console.log("JavaScript", error.message.split(" ").slice(0, 3).join(" "));
}
process.exit();
JAVASCRIPT
mkdir -p "$folder/src"
cat > "$folder/Cargo.toml" <<'TOML'
[package]
name = "tryout"
version = "0.1.0"
edition = "2021"

[dependencies]
mcap = { version = "=0.26.0", default-features = false }
TOML
cat > "$folder/src/main.rs" <<'RUST'
fn main() {
    let content = std::fs::read("log.mcap").unwrap();
    for message in mcap::MessageStream::new(&content).unwrap() {
        match message {
            Ok(message) => println!("Rust {}", String::from_utf8_lossy(&message.data)),
            Err(error) => println!("Rust {error}"),
        }
    }
}
RUST
cd "$folder"
npm install --silent --no-audit --no-fund @mcap/core@2.2.2 @mcap/nodejs@1.0.2 >/dev/null
cargo build --quiet
{ venv/bin/python -W ignore try.py && target/debug/tryout && node try.mjs; } > seen
echo "mcap 1.6.0 (Python), mcap 0.26.0 (Rust), @mcap/core 2.2.2 (Node.js): the file said 1 when its checksum was made"
echo "guess: Rust checks as it reads, the others when asked"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
Python {"position": 9}
Python validate_crcs CRCValidationError
Rust {"position": 9}
JavaScript Incorrect chunk CRC
SEEN
