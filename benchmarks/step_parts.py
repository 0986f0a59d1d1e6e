"""What the parts of a step of two_link take, each by itself: `python -m benchmarks.step_parts`.

The participants of a run in one process, driven by a plain loop: each message is encoded once and
decoded by its reader. A run adds turns, releases, log and deadlines. Prints 10th percentiles [µs].
"""

import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from time import perf_counter_ns
from typing import Any
from unittest.mock import patch

from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_participant.session.exchange import ExchangingLoop
from stepbus_schemas import encode

STEPS = 20_000
_loops: dict[str, Any] = {}
_times = defaultdict[str, list[int]](list)
_work = ExchangingLoop._work


def _timed(part: str, call: Any, *given: Any) -> Any:
    began = perf_counter_ns()
    result = call(*given)
    _times[part].append(perf_counter_ns() - began)
    return result


def drive(loop: Any) -> None:
    """Leave the others where they wait for this loop's participant, and drive all from here."""
    _loops[loop._outbox.name] = loop
    if len(_loops) < 3:
        _work(loop)
    published: dict[tuple[str, str], bytes] = {}
    for index in range(1, STEPS + 1):
        for part in ("mission_update", "plant_output", "controller_update", "plant_update"):
            name, _, method = part.partition("_")
            one = _loops[name]
            one.step.index = index
            for item in one._inputs if method == "update" else ():
                data = published[item.config.source, item.config.port]
                item.fresh, item.value = True, _timed("decode", item._decode, data)
            for port, message in (_timed(part, getattr(one, f"_{method}"), one.step) or {}).items():
                published[name, port] = _timed("encode", encode, message)
        _timed("clock", int)
    clock = sorted(_times.pop("clock"))[STEPS // 10]
    for part, row in _times.items():
        each = (sorted(row)[len(row) // 10] - clock) * 1e-3
        print(f"{part:18} {each:5.2f} × {len(row) // STEPS}", file=sys.__stdout__)
    raise KeyboardInterrupt  # the run is of no more use


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, patch.object(ExchangingLoop, "_work", drive):
        run(load("two_link"), Options(out=Path(folder) / "run", host=host_of(in_process=True)))
