"""A program behind the bridge that goes wrong on purpose: `bridged.py FORMAT KIND STEP`."""

import json
import math
import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import msgpack

FORM, KIND, STEP = sys.argv[1], sys.argv[2], int(sys.argv[3])
MOST = 16 << 20


def take(size):
    """Return so many bytes; at the end of file, end."""
    data = b""
    while len(data) < size:
        chunk = os.read(3, size - len(data))
        if not chunk:
            while KIND == "plot" and not Path("plotted").exists():
                time.sleep(0.02)
            sys.exit(3 if KIND == "code" else 0)
        data += chunk
    return data


def read():
    if FORM == "json":
        line = b""
        while not line.endswith(b"\n"):
            line += take(1)
        return json.loads(line)
    return msgpack.unpackb(take(int.from_bytes(take(4), "little")))


def put(data):
    while data:
        data = data[os.write(4, data) :]


def framed(value):
    if FORM == "json":
        return json.dumps(value).encode() + b"\n"
    data = msgpack.packb(value)
    return len(data).to_bytes(4, "little") + data


def die(number):
    os.kill(os.getpid(), number)
    time.sleep(60)


def go_wrong(right):
    """Do what the kind says; right: the answer it should be."""
    answers = {
        "garbage": b"hello world\n" if FORM == "json" else b"\x05\0\0\0\xc1abcd",
        "mistyped": framed({"outputs": {"command": {"mode": "torque", "values": "many"}}}),
        "word": framed({"outputs": {"command": {"mode": "torqe", "values": [1, 2]}}}),
        "lacking": framed({"outputs": {"command": {"mode": "torque"}}}),
        "port": framed({"outputs": {"komand": {"mode": "torque", "values": [1, 2]}}}),
        "twice": right + right,
        "oversize": (MOST + 1).to_bytes(4, "little") if FORM == "msgpack" else b"x" * (MOST + 2),
        "nan": framed({"outputs": {"command": {"mode": "torque", "values": [math.nan, None]}}}).replace(b"NaN", b"null"),
        "whole": framed({"outputs": {"command": {"mode": "torque", "values": [1, -2]}}, "more": 1}),
        "end": framed({"end": "enough"}),
        "long": framed({"outputs": {"command": {"mode": "torque", "values": [0.5] * 20000}}}),
    }  # fmt: skip
    if KIND in answers:
        put(answers[KIND])
    elif KIND == "raise":
        print("error: the knee is jammed\nlibrary 1.0", file=sys.stderr)
        sys.exit(3)
    elif KIND == "kill":
        die(signal.SIGKILL)
    elif KIND == "stop":
        die(signal.SIGSTOP)
    elif KIND == "hang":
        Path("pid").write_text(f"{os.getpid()};")
        time.sleep(60)
    elif KIND == "close":
        os.close(4)
        time.sleep(60)
    elif KIND in {"half", "cut"}:
        put(right[: len(right) // 2])
        time.sleep(60 if KIND == "half" else 0)
        os._exit(0)
    elif KIND == "child":
        subprocess.Popen(["sleep", "1000"])
        time.sleep(60)
    else:
        put(right)


def maps():
    while True:
        message = read()
        if "welcome" in message:
            if STEP < 0:
                go_wrong(framed({"ready": {}}))
            else:
                put(framed({"ready": {"versions": {"knee": "1.0"}}}))
            print(json.dumps(message["welcome"]["params"]))
        elif "start" in message:
            print(message["start"]["inputs"]["joint_state"]["names"])
        else:
            values = [0.5 * q for q in message["update"]["inputs"]["joint_state"]["position"]]
            right = framed({"outputs": {"command": {"mode": "torque", "values": values}}})
            go_wrong(right) if message["update"]["step"] == STEP else put(right)


def numbers(count):
    return struct.unpack(f"<{count}d", take(8 * count))


def raw():
    put(struct.pack("<d", 2.0 if KIND == "unready" else 1.0))
    header = numbers(8)
    print(header, numbers(int(header[7])))
    n_in, n_out = int(header[4]), int(header[5])
    while True:
        given = numbers(n_in)
        n = n_out - 1
        right = struct.pack(f"<{n_out}d", 0.0, *(0.5 * q for q in given[3 : 3 + n]))
        if given[0] != STEP:
            put(right)
        elif KIND == "mode":
            put(struct.pack(f"<{n_out}d", 7.0, *[0.0] * n))
        else:
            go_wrong(right)


raw() if FORM == "raw" else maps()
