"""Sales in the store with the camera in the loop, one run per seed of the stock.

Each seed makes another stock: which type stands where, how it stands, how heavy and how slippery it
is. The type that is ordered changes with the seed as well. Printed is a table of medians by type:
`python benchmarks/store.py [--seeds 20] [--first 0] [--set KEY=VALUE …]`.
"""

import argparse
import math
import re
import statistics
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from mcap.reader import make_reader

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

TYPES = ("cola", "juice", "water", "soup")
_ROW = re.compile(
    r"^1 +(?P<item>\S+) +(?P<attempts>\d+) +\S+(?: mm)? +(?P<seen>[\d.]+) mm +\S+(?: mm)?"
    r" +(?P<duration>[\d.]+) s$",
    re.MULTILINE,
)


class Sale(NamedTuple):
    """The result of one order; lengths [mm], duration of simulation [s].

    seen: distance of the item from its spot as the mission saw it. place: the same in truth.
    others: largest displacement of another item. drift: error of the base's pose at the end.
    """

    seed: int
    item_type: str
    outcome: str
    item: str = ""
    attempts: str = ""
    seen: str = ""
    place: str = ""
    others: str = ""
    drift: str = ""
    duration: str = ""
    real_time: str = ""


def sell(scenario: str, seed: int, settings: Sequence[str], out: Path) -> Sale:
    """Run one sale from a stock of its own."""
    item_type = TYPES[seed % len(TYPES)]
    wanted = [f"plant.params.stock.seed={seed}", f"mission.params.orders=[{item_type}]", *settings]
    loaded = load(scenario, wanted)
    result = run(loaded, Options(out=out, host=InProcess()))
    row = _ROW.search(summary(out / "run.mcap"))
    if result.exit_code or row is None:
        return Sale(seed, item_type, result.reason)
    mission = next(spec for spec in loaded.participants if spec.name == "mission")
    truth = measure(Recording(out / "run.mcap"), row["item"], mission.params["outlet"]["position"])
    return Sale(
        seed,
        item_type,
        "sold",
        **row.groupdict(),
        **{key: f"{value * 1e3:.1f}" for key, value in truth.items()},
        real_time=f"{result.real_time_factor:.1f}",
    )


def measure(recording: Recording, item: str, outlet: Sequence[float]) -> dict[str, float]:
    """Return errors and displacements of a sale by the true poses [m]; outlet: the spot [m]."""
    poses = recording["plant.poses"]
    names, types = poses.description.names, poses.description.details["type"]
    rows = poses["position"].reshape(len(poses), len(names), 3)
    moved = np.linalg.norm(rows[-1] - rows[0], axis=1)
    others = [n for n, name in enumerate(names) if types[n] and name != item]
    pose = recording["world.pose" if "world.pose" in recording else "plant.odometry"]
    base = rows[-1][names.index("chassis")]
    return {
        "place": math.dist(rows[-1][names.index(item)][:2], outlet[:2]),
        "others": float(moved[others].max()),
        "drift": math.hypot(pose["x"][-1] - base[0], pose["y"][-1] - base[1]),
    }


def summary(log: Path) -> str:
    """Return the mission's summary."""
    with log.open("rb") as file:
        messages = make_reader(file).iter_messages(topics=["mission/summary"])
        return "\n".join(msgspec.msgpack.decode(message.data)["text"] for _, _, message in messages)


def by_type(sales: Sequence[Sale]) -> str:
    """Return the results of the orders by type, and of all, as a table in Markdown."""
    groups = {name: [sale for sale in sales if sale.item_type == name] for name in TYPES}
    rows = [
        (
            "type",
            "sold",
            "place",
            "place, most",
            "others, most",
            "drift, most",
            "duration",
            "longest",
        ),
        ("---",) * 8,
        *(_row(name, group) for name, group in {**groups, "all": list(sales)}.items() if group),
    ]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _row(name: str, group: Sequence[Sale]) -> tuple[str, ...]:
    sold = [sale for sale in group if sale.outcome == "sold"]
    count = f"{len(sold)} of {len(group)}"
    if not sold:
        return name, count, *("",) * 6
    place, others, drift, duration = (
        [float(getattr(sale, key)) for sale in sold]
        for key in ("place", "others", "drift", "duration")
    )
    numbers = (
        *(statistics.median(place), max(place)),
        *(max(others), max(drift), statistics.median(duration), max(duration)),
    )
    return name, count, *(f"{number:.1f}" for number in numbers)


def main() -> int:
    """Print the table; exit with 1 where fewer than 95 % were sold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="store", help="or store/truth")
    parser.add_argument("--seeds", type=int, default=20, help="number of stocks (default: 20)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first stock")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    args = parser.parse_args()
    sales: list[Sale] = []
    for seed in range(args.first, args.first + args.seeds):
        with tempfile.TemporaryDirectory(prefix="stepbus-store-") as folder:
            sales.append(sell(args.scenario, seed, args.settings, Path(folder) / "run"))
        print(" ".join(map(str, sales[-1])), file=sys.stderr, flush=True)
    sold = sum(sale.outcome == "sold" for sale in sales)
    print(by_type(sales))
    print(f"\n{sold} of {len(sales)} sold")
    return 0 if sold >= 0.95 * len(sales) else 1


if __name__ == "__main__":
    raise SystemExit(main())
