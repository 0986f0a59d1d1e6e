"""Random multi-rate scenarios agree, value by value, with a model of the clauses P6.1 to P6.4.

The model knows the page only: neither it nor what reads the recordings uses code of ours.
`ALL_MULTIRATE=1 pytest -m slow …` runs all of them in processes too.
"""

import json
import os
import random
from contextlib import suppress

import msgpack
import pytest
from mcap.reader import make_reader
from support.paths import PROGRAMS

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load

STEPS = 150
COUNT = 200
IN_PROCESSES = range(COUNT) if os.environ.get("ALL_MULTIRATE") else range(0, COUNT, 20)
PATIENT = {"step_timeout": "60s", "stop_timeout": "60s", "ready_timeout": "60s"}


def participant(rng, names):
    """Return a participant that reads some of the others, or none."""
    inputs = {
        f"in{n}": {"from": f"{rng.choice(names)}.out", "delay": rng.choice((0, 0, 1, 2, rng.randint(3, 70)))}
        for n in range(rng.choice((0, 1, 1, 2, 3)))
    }  # fmt: skip
    return {
        "participant": "echo.py:Echo",
        "publishes": rng.choice(("first", "last", "last")),
        "every": rng.choice((1, 1, rng.randint(2, 10))),
        "inputs": inputs,
        "outputs": {"out": "Echo/1"},
        "params": {"silent": rng.choice((0, 0, 2, 3, 5))},
        **PATIENT,
    }


def scenario(seed, folder):
    """Return a random scenario that is valid: those with algebraic loops are drawn again."""
    rng = random.Random(seed)
    (folder / "echo.py").write_bytes((PROGRAMS / "echo.py").read_bytes())
    while True:
        names = [f"p{n}" for n in range(rng.randint(2, 4))]
        data = {
            "name": "multirate",
            "step": "1ms",
            "duration": f"{STEPS}ms",
            "window": rng.choice((1, 2, 3, 64, rng.randint(1, 64))),
            "types": {"Echo/1": {"step": "int", "read": "int[k]"}},
            "participants": {
                name: participant(rng, [other for other in names if other != name])
                for name in names
            },
        }
        path = folder / "scenario.yaml"
        path.write_text(json.dumps(data))
        with suppress(ScenarioError):
            return data["participants"], load(path)


def publishes(row, step):
    """Return whether a participant publishes a message at a step."""
    silent = row["params"]["silent"]
    return step % row["every"] == 0 and not (silent and step // row["every"] % silent == 1)


def held(rows, item, step):
    """Return the step of the message that an input holds at a step (P6.1, P6.3); -1: none."""
    source, reach = rows[item["from"].removesuffix(".out")], step - item["delay"]
    if reach < 0:
        return -1
    due = reach - reach % source["every"]
    return next((at for at in range(due, -1, -1) if publishes(source, at)), -1)


def expected(rows):
    """Return participant → step → what it publishes there: the steps of what it has read."""
    content = {}
    for name, row in rows.items():
        inputs = [row["inputs"][port] for port in sorted(row["inputs"])]
        read, before = {}, [-1] * len(inputs)
        for step in range(0, STEPS, row["every"]):
            now = [held(rows, item, step) for item in inputs]
            read[step] = before if row["publishes"] == "first" else now
            before = now
        content[name] = {step: row_ for step, row_ in read.items() if publishes(row, step)}
    return content


def recorded(result, rows):
    """Return the same from a recording."""
    content = {name: {} for name in rows}
    with result.recording.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            name, _, port = channel.topic.partition("/")
            if port == "out" and message.sequence < STEPS:
                content[name][message.sequence] = msgpack.unpackb(message.data)["read"]
    return content


def check(seed, folder, *, in_process):
    rows, loaded = scenario(seed, folder)
    result = run(loaded, Options(out=folder / "run", host=host_of(in_process=in_process)))
    assert (result.exit_code, result.steps) == (0, STEPS), (seed, result.reason)
    assert recorded(result, rows) == expected(rows), seed


SEEDS = [pytest.param(n, marks=[pytest.mark.slow] if n >= 8 else []) for n in range(COUNT)]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_random_scenario_agrees_with_the_page(tmp_path, seed):
    check(seed, tmp_path, in_process=True)


@pytest.mark.slow
@pytest.mark.parametrize("seed", IN_PROCESSES)
def test_so_do_those_in_processes(tmp_path, seed):
    check(seed, tmp_path, in_process=False)
