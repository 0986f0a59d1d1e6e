#!/usr/bin/env bash
# Zenoh: a query to all gets one reply only, the last to arrive, though no reply has a timestamp.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
cat > "$folder/ask.py" <<'PYTHON'
import contextlib, json, sys, time, zenoh

address = f"unixsock-stream/{sys.argv[1]}/asker.sock"

def opened(stack, end):
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5(f"{end}/endpoints", json.dumps([address]))
    return stack.enter_context(zenoh.open(config))

def answer(text, after_s):
    def reply(query):
        with query:
            time.sleep(after_s)
            assert query.key_expr == "key"
            query.reply("key", text)
    return reply

with contextlib.ExitStack() as stack:
    asker = opened(stack, "listen")
    for text, after_s in (("first", 0.0), ("second", 0.3)):
        opened(stack, "connect").declare_queryable("key", answer(text, after_s))
    time.sleep(1.0)
    everyone = {"target": zenoh.QueryTarget.ALL}
    for name, more in {"default": {}, "NONE": {"consolidation": zenoh.ConsolidationMode.NONE}}.items():
        replies = [reply.ok for reply in asker.get("key", **everyone, **more)]
        assert all(sample.timestamp is None for sample in replies)
        print(name, *(sample.payload.to_string() for sample in replies))
PYTHON
timeout 60 "$folder/venv/bin/python" "$folder/ask.py" "$folder" > "$folder/seen"
echo "eclipse-zenoh 1.10.2"
echo "guess: without timestamps no reply is newer than another: target ALL yields both"
echo "seen:  replies by consolidation:"
cat "$folder/seen"
printf 'default second\nNONE first second\n' | cmp - "$folder/seen"
