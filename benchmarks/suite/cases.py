"""The cases of the suite: each is a command that prints one line of JSON."""

import json
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

BENCHMARKS = Path(__file__).parents[1]
CONTROLLER_C = BENCHMARKS.parent / "examples/controllers/c/controller"
RUST = BENCHMARKS.parent / "clients/rust"
CHAIN = "chain by hand: pyzmq"


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case. command: without the number of steps, which is its last argument."""

    name: str
    command: tuple[str, ...]
    steps: int = 12_000
    few_steps: int = 100


def _program(name: str, module: str, *arguments: str, steps: int = 12_000) -> Case:
    command = (sys.executable, "-m", f"benchmarks.suite.{module}", *arguments)
    return Case(name=name, command=command, steps=steps, few_steps=min(100, steps // 4))


def _stepbus(name: str, *, steps: int = 12_000, **spec: object) -> Case:
    return _program(name, "stepbus_case", json.dumps(spec), steps=steps)


PICTURES = ((320, 240, 1600), (1280, 720, 400))
"""Width, height, and how many steps."""


def picture_peers() -> list[Case]:
    """Return pictures over the shared memory of others."""
    return [
        _program(
            f"{name}, noise of {w}×{h} a step, not recorded",
            "peers.pictures",
            kind,
            str(w),
            str(h),
            steps=5 * steps,
        )
        for w, h, steps in PICTURES
        for name, kind in (("dora-rs", "dora"), ("iceoryx2", "iceoryx2"))
    ]


def peers() -> list[Case]:
    """Return the arm coupled by other means."""
    return [
        _program("one loop, no coupling", "peers.loop", "pybullet", steps=100_000),
        _program("one loop, MuJoCo", "peers.loop", "mujoco", steps=100_000),
        _program(CHAIN, "peers.chain", "pyzmq"),
        _program("chain by hand: Zenoh", "peers.chain", "zenoh"),
        _program("HELICS, ipc", "peers.federation", "ipc", steps=6000),
        _program("HELICS, zmq", "peers.federation", "zmq", steps=3000),
        _program("mosaik 3.6", "peers.mosaik_chain", steps=1000),
    ]


def two_link() -> list[Case]:
    """Return the arm under stepbus."""
    delayed = ["controller.inputs.joint_state={from: plant.joint_state, delay: 1}"]
    return [
        *(_stepbus(f"two_link, window {w}", window=w) for w in (64, 16, 4, 1)),
        _stepbus("two_link, window 64, delayed coupling", window=64, overrides=delayed),
        _stepbus("two_link, window 64, not recorded", window=64, recorded=False),
        _stepbus("two_link, in one process", window=64, in_process=True),
        _stepbus("two_link, in one process, not recorded", window=64, in_process=True,
                 recorded=False),
        _stepbus("two_link, in one process, MuJoCo", window=64, in_process=True,
                 overrides=["plant.params.engine=mujoco"]),
    ]  # fmt: skip


def echoes() -> list[Case]:
    """Return participants that only pass messages on."""
    cases = [_stepbus(f"echo, {n} participants", participants=n) for n in (2, 3, 6, 12)]
    cases.append(_stepbus("echo, fan-out 1 → 8", fan_out=8))
    cases.append(_stepbus("echo, fan-out 1 → 8, fan-in 8 → 1", fan_out=8, fan_in=8))
    cases += [_stepbus(f"echo, {n} joints", joints=n) for n in (14, 100)]
    cases += [
        _stepbus(f"echo, noise of {w}×{h} a step{word}", image=[w, h], steps=steps, **how)
        for w, h, steps in PICTURES
        for word, how in (("", {}), (", not recorded", {"record": "off"}))
    ]
    if CONTROLLER_C.exists() or shutil.which("gcc"):
        cases.append(_stepbus("echo, bridge to C", bridge=True))
    if shutil.which("cargo"):
        cases.append(_stepbus("echo, 3 participants in Rust", rust=True))
    return cases


def parts() -> list[Case]:
    """Return an environment, plants by themselves, and the store with a camera that is late."""
    worlds = (("two_link", 4000), ("baxter", 400), ("boxes", 2000))
    return [
        _program("two_link, Gymnasium environment", "gym_case"),
        _program("Gymnasium environment by hand", "peers.environment", steps=100_000),
        *(
            _program(f"plant alone, {world}, {engine}", "engine_case", world, engine, steps=steps)
            for world, steps in worlds
            for engine in ("pybullet", "mujoco")
        ),
    ]


def all_cases() -> list[Case]:
    """Return all cases, in the order of the table."""
    return [*peers(), *two_link(), *echoes(), *picture_peers(), *parts()]
