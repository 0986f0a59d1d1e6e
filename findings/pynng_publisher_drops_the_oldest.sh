#!/usr/bin/env bash
# nng: a publisher whose subscriber is behind drops the oldest messages and keeps the newest. ZeroMQ,
# whose patterns nng has, keeps the oldest and drops the newest. What reads late differs altogether.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pynng==0.9.0 pyzmq==27.1.0
"$folder/venv/bin/python" - <<'PYTHON'
import sys
import time
from importlib.metadata import version

import pynng
import zmq

COUNT, KEPT = 20_000, 16


def of_nng():
    with (
        pynng.Pub0(listen="inproc://numbers") as pub,
        pynng.Sub0(dial="inproc://numbers", topics=b"", recv_timeout=1000) as sub,
    ):
        pub.send_buffer_size = sub.recv_buffer_size = KEPT
        time.sleep(0.5)
        for number in range(COUNT):
            pub.send(str(number).encode())
        time.sleep(0.5)
        numbers = []
        try:
            while True:
                numbers.append(int(sub.recv()))
        except pynng.Timeout:
            return numbers


def of_zeromq():
    context = zmq.Context()
    pub, sub = context.socket(zmq.PUB), context.socket(zmq.SUB)
    pub.setsockopt(zmq.SNDHWM, KEPT)
    sub.setsockopt(zmq.RCVHWM, KEPT)
    sub.setsockopt(zmq.SUBSCRIBE, b"")
    sub.setsockopt(zmq.RCVTIMEO, 1000)
    pub.bind("inproc://numbers")
    sub.connect("inproc://numbers")
    time.sleep(0.5)
    for number in range(COUNT):
        pub.send(str(number).encode())
    numbers = []
    try:
        while True:
            numbers.append(int(sub.recv()))
    except zmq.Again:
        return numbers


seen = {"pynng": of_nng(), "pyzmq": of_zeromq()}
print("guess: with full queues, both keep the oldest messages and drop the newest")
for name, numbers in seen.items():
    print(f"seen in {name} {version(name)}: {len(numbers)} of {COUNT}, the last is {numbers[-1]}")
as_seen = seen["pynng"][-1] == COUNT - 1 and seen["pyzmq"] == list(range(len(seen["pyzmq"])))
sys.exit(not (as_seen and all(len(numbers) < 200 for numbers in seen.values())))
PYTHON
