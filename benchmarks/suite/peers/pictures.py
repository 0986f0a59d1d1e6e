"""Pictures over dora-rs and iceoryx2: plant → controller → plant, not recorded, no orchestrator.

Each step, the plant sends a noisy picture through the peer's shared memory, the controller copies
it out and answers with 8 bytes.
`python -m benchmarks.suite.peers.pictures dora|iceoryx2 WIDTH HEIGHT STEPS`.
"""

import ctypes
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.suite.clock import Clock

BYTES = 3
ANSWER = bytes(8)


def noise(size: int) -> bytes:
    """Return a picture that does not compress; the same each time."""
    return np.random.default_rng(1).integers(0, 256, size, np.uint8).tobytes()


class Iceoryx2:
    """Data over a service of slices; a service of events wakes the reader, as nobody spins."""

    def __init__(self, name: str, size: int, *, sends: bool) -> None:
        import iceoryx2 as iox2  # noqa: PLC0415  of this peer only

        self._iox2: Any = iox2
        self._node: Any = iox2.NodeBuilder.new().create(iox2.ServiceType.Ipc)
        key = f"stepbus-bench-{os.getppid()}-{name}"
        data = self._node.service_builder(iox2.ServiceName.new(key))
        self._data: Any = data.publish_subscribe(iox2.Slice[ctypes.c_uint8]).open_or_create()
        event = self._node.service_builder(iox2.ServiceName.new(key + "-event"))
        self._event: Any = event.event().open_or_create()
        if sends:
            self._out: Any = self._data.publisher_builder().initial_max_slice_len(size).create()
            self._wake: Any = self._event.notifier_builder().create()
        else:
            self._in: Any = self._data.subscriber_builder().create()
            self._woken: Any = self._event.listener_builder().create()

    def put(self, data: bytes) -> None:
        """Send to the other side."""
        sample = self._out.loan_slice_uninit(len(data))
        ctypes.memmove(sample.payload().data_ptr, data, len(data))
        sample.assume_init().send()
        self._wake.notify()

    def get(self) -> bytes:
        """Return the next message, copied."""
        while True:
            sample = self._in.receive()
            if sample is not None:
                payload = sample.payload()
                return ctypes.string_at(payload.data_ptr, payload.len())
            self._woken.timed_wait(self._iox2.Duration.from_secs(10))


def iceoryx2(size: int, steps: int) -> None:
    """Run both sides, each in a process."""
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(2)
    sides = [context.Process(target=side, args=(size, steps, barrier)) for side in (_plant, _law)]
    for process in sides:
        process.start()
    for process in sides:
        process.join()


def _plant(size: int, steps: int, barrier: Any) -> None:
    picture = noise(size)
    out, back = Iceoryx2("picture", size, sends=True), Iceoryx2("answer", 8, sends=False)
    barrier.wait(30)
    clock = Clock()
    for _ in range(steps):
        out.put(picture)
        back.get()
        clock.tick()
    clock.show()


def _law(size: int, steps: int, barrier: Any) -> None:
    back, out = Iceoryx2("picture", size, sends=False), Iceoryx2("answer", 8, sends=True)
    barrier.wait(30)
    for _ in range(steps):
        assert len(back.get()) == size
        out.put(ANSWER)


def dora(size: int, steps: int) -> None:
    """Write the dataflow, and let dora run it."""
    here = str(Path(__file__).parents[3])
    path = os.pathsep.join([here, os.environ.get("PYTHONPATH", "")])
    with tempfile.TemporaryDirectory(prefix="bench-") as name:
        shown = Path(name) / "shown"
        common = {"path": sys.executable, "env": {"PYTHONPATH": path}}
        sides = (("plant", "picture", "law/answer"), ("law", "answer", "plant/picture"))
        nodes = [
            common
            | {"id": side, "outputs": [output], "inputs": {"in": source}}
            | {"args": f"-m benchmarks.suite.peers.pictures {side} {size} {steps} {shown}"}
            for side, output, source in sides
        ]
        flow = Path(name) / "dataflow.yml"
        flow.write_text(json.dumps({"nodes": nodes}))
        programs = [Path(entry) / "bin/dora" for entry in path.split(os.pathsep)]
        program = next(str(file) for file in programs if file.exists())
        subprocess.run(
            [program, "run", str(flow)],
            cwd=name, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        sys.stdout.write(shown.read_text())


def _dora_node(name: str, size: int, steps: int, shown: Path) -> None:
    import pyarrow as pa  # noqa: PLC0415  of this peer only
    from dora import Node  # noqa: PLC0415

    node: Any = Node()

    def get() -> bytes:
        while True:
            event = node.next()
            if event["type"] == "INPUT":
                return bytes(event["value"].to_numpy())
            if event["type"] == "STOP":
                raise SystemExit

    if name == "law":
        answer = pa.array(np.frombuffer(ANSWER, np.uint8))
        for _ in range(steps):
            assert len(get()) == size
            node.send_output("answer", answer)
        return
    picture = pa.array(np.frombuffer(noise(size), np.uint8))
    clock = Clock()
    for _ in range(steps):
        node.send_output("picture", picture)
        get()
        clock.tick()
    with shown.open("w") as file:
        sys.stdout = file
        clock.show()
        sys.stdout = sys.__stdout__


if __name__ == "__main__":
    kind, *rest = sys.argv[1:]
    if kind in {"plant", "law"}:
        _dora_node(kind, int(rest[0]), int(rest[1]), Path(rest[2]))
    else:
        width, height, number = map(int, rest)
        {"dora": dora, "iceoryx2": iceoryx2}[kind](BYTES * width * height, number)
