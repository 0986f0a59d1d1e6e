"""What undisturbed runs cost: simulated time and messages, the same on every machine.

`python -m stepbus_simulation.costs > tests/simulation/costs.json` keeps what they cost now.
"""

import json
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from .execution import Execution
from .network import Link, Parcel
from .programs import SCENARIOS
from .tape import FOLDER, Knobs, Tape

_KNOBS = {
    "one step in flight": Knobs(window=1),
    "no batches": Knobs(batch=1, compute_us=100),
    "slow": Knobs(window=8, compute_us=2_000, link_us=1_000),
}


def costs() -> dict[str, dict[str, Any]]:
    """Return what a run of each scenario costs, and of one with other knobs."""
    rows = {name: _cost(Tape(name)) for name in SCENARIOS}
    return rows | {f"seen, {what}": _cost(Tape("seen", knobs=it)) for what, it in _KNOBS.items()}


def _cost(tape: Tape) -> dict[str, Any]:
    """Return how long a run takes [µs], who waits and computes how long, and how often each sends.

    A message counts once for each reader. Sizes are left out: they have paths and versions of this
    machine.
    """
    sent: Counter[str] = Counter()

    def count(link: Link, key: str, data: bytes) -> list[Parcel]:
        sent[f"{link.source.process.name}: {key.partition('/')[0]}"] += 1
        return [Parcel(data)]

    with TemporaryDirectory(dir=FOLDER) as folder:
        execution = Execution(tape, Path(folder) / "run")
        execution.network.change = count
        execution.run()
    state = execution.watch.state
    return {
        "lasts": execution.orchestrator.ended_ns // 1000,
        "waited": {name: waited // 1000 for name, waited in sorted(state.waited.items())},
        "computed": {name: total // 1000 for name, (total, _) in sorted(state.compute.items())},
        "sent": dict(sorted(sent.items())),
    }


if __name__ == "__main__":
    print(json.dumps(costs(), indent=1))
