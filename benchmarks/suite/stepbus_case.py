"""One run of stepbus, whose figures it prints as JSON.

`python -m benchmarks.suite.stepbus_case SPEC STEPS`.

SPEC: JSON with window, overrides, in_process, recorded, and for participants that only pass on
messages: participants, fan_out and fan_in (relays side by side), joints, image, record (of the
image), bridge, rust.
"""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec
import psutil
from mcap.reader import make_reader

from stepbus_orchestrator.recording.timing import StepTiming
from stepbus_orchestrator.run.run_scenario import Options, host_of
from stepbus_orchestrator.run.run_scenario import run as run_scenario
from stepbus_orchestrator.scenario.load import load

from .cases import BENCHMARKS, CONTROLLER_C, RUST

ECHO = BENCHMARKS / "echo"
_SAMPLE_S = 0.1


def scenario_of(spec: dict[str, Any], folder: Path) -> str:
    """Return the path of the scenario that a specification asks for, made where it is no arm."""
    if not {"participants", "fan_out", "fan_in", "joints", "image", "bridge", "rust"} & spec.keys():
        return "two_link"
    shutil.copy(ECHO / "echo.py", folder)
    relays = spec.get("participants", 3) - 2
    params = {"joints": spec.get("joints", 2), "image": spec.get("image", [])}
    plant = {
        "participant": "echo.py:Plant",
        "publishes": "first",
        "inputs": {"command": "controller.command"},
        "outputs": {"joint_state": "JointState/1"},
        "params": params,
    }
    inputs: dict[str, Any] = {"joint_state": "plant.joint_state"}
    if params["image"]:
        image = {"type": "Image/1", "bulk": True, "record": spec.get("record", "all")}
        plant["outputs"] = {"joint_state": "JointState/1", "image": image}
        inputs["image"] = "plant.image"
    rows: dict[str, Any] = {"plant": plant}
    before = "plant.joint_state"
    for number in range(relays - 1):
        rows[f"relay{number}"] = _relay(before)
        before = f"relay{number}.joint_state"
    inputs["joint_state"] = before
    for number in range(spec.get("fan_out", 0)):
        rows[f"side{number}"] = _relay("plant.joint_state")
    inputs |= {
        f"side{number}": f"side{number}.joint_state" for number in range(spec.get("fan_in", 0))
    }
    if relays:
        inputs["reference"] = "mission.reference"
        rows["mission"] = {
            "participant": "echo.py:Mission",
            "outputs": {"reference": "JointReference/1"},
            "params": {"joints": params["joints"]},
        }
    rows["controller"] = {
        "participant": "echo.py:Controller",
        "inputs": inputs,
        "outputs": {"command": "JointCommand/1"},
    }
    if spec.get("bridge"):
        subprocess.run(["make", "-s", "-C", str(CONTROLLER_C.parent)], check=True)
        shutil.copy(CONTROLLER_C, folder)
        program = {"exec": ["./controller"], "bridge": "msgpack", "params": {"kp": 200, "kd": 30}}
        del rows["controller"]["participant"]
        rows["controller"] |= program
    if spec.get("rust"):
        binary = _built_in_rust()
        for name, row in rows.items():
            row.pop("participant", None)
            row["exec"] = [binary, name]
    path = folder / "scenario.yaml"
    # JSON is YAML too.
    path.write_text(
        json.dumps({"name": "echo", "step": "5ms", "duration": "20s", "participants": rows})
    )
    return str(path)


def _relay(source: str) -> dict[str, Any]:
    return {
        "participant": "echo.py:Relay",
        "inputs": {"joint_state": source},
        "outputs": {"joint_state": "JointState/1"},
    }


def _built_in_rust() -> str:
    """Return the path of the echo in Rust, built where it is not."""
    command = ["cargo", "build", "--release", "--quiet", "--example", "echo"]
    subprocess.run(command, cwd=RUST, check=True, env={**os.environ, "CARGO_TARGET_DIR": "target"})
    return str(RUST / "target/release/examples/echo")


class Memory:
    """Samples how much memory this process and those it has started hold, at most [MB]."""

    def __init__(self) -> None:
        self.largest: dict[int, float] = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def _work(self) -> None:
        own = psutil.Process()
        while not self._over.wait(_SAMPLE_S):
            for process in (own, *own.children()):
                with contextlib.suppress(psutil.NoSuchProcess):
                    size = process.memory_info().rss / 1e6
                    self.largest[process.pid] = max(size, self.largest.get(process.pid, 0.0))

    def close(self) -> list[float]:
        """Return the largest of each process, this one first."""
        self._over.set()
        self._thread.join()
        return [round(size, 1) for _, size in sorted(self.largest.items())]


def step_times_us(timing: Path) -> list[float]:
    """Return the times of the plant's steps, sorted [µs]."""
    decode = msgspec.msgpack.Decoder(StepTiming).decode
    with timing.open("rb") as file:
        records = [decode(item.data) for *_, item in make_reader(file).iter_messages(["steps"])]
    rows = [row for record in records if record.participant == "plant" for row in record.rows]
    return sorted((waited + computed) * 1e-3 for _, waited, computed in rows)


def main(text: str, steps: int) -> None:
    """Run once."""
    spec = json.loads(text)
    window = spec.get("window", 64)
    if not spec.get("recorded", True):
        # No option for users turns it off, so that this reaches inside.
        recorder: Any = import_module("stepbus_orchestrator.recording").Recorder
        recorder.offer = recorder.write_below = lambda *_: None
    overrides = [f"window={window}", *spec.get("overrides", ())]
    with tempfile.TemporaryDirectory(prefix="bench-") as name:
        folder = Path(name)
        scenario = replace(load(scenario_of(spec, folder), overrides), steps=steps)
        memory = Memory()
        options = Options(
            out=folder / "run", host=host_of(in_process=spec.get("in_process", False))
        )
        result = run_scenario(scenario, options)
        if result.exit_code:
            raise SystemExit(result.reason)
        times = step_times_us(folder / "run/timing.mcap")
        shown = {
            "rate": result.steps / result.wall_s,
            "p50": times[len(times) // 2],
            "p99": times[min(len(times) - 1, len(times) * 99 // 100)],
            "max": times[-1],
            "start_s": result.start_s,
            "bytes": result.recording.stat().st_size / steps,
            "memory": memory.close(),
        }
    sys.stdout.write(json.dumps(shown) + "\n")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
