"""Sales in the store with the camera in the loop, one run per seed of the stock.

Each seed makes another stock: which type stands where, how it stands, how heavy and how slippery it
is. The type that is ordered changes with the seed as well. Printed is a table for docs and README:
`python benchmarks/store.py [--seeds 20] [--first 0] [--set KEY=VALUE …]`.
"""

import argparse
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
from mcap.reader import make_reader

from stepbus_orchestrator import Options, load
from stepbus_orchestrator import run_scenario as run

TYPES = ("cola", "juice", "water", "soup")
_ROW = re.compile(
    r"^1 +(?P<item>\S+) +(?P<attempts>\d+) +(?P<detection>[\d.]+) mm +(?P<place>[\d.]+) mm"
    r" +(?P<others>[\d.]+) mm +(?P<duration>[\d.]+) s$",
    re.MULTILINE,
)


class Sale(NamedTuple):
    """What came of one order; lengths [mm], duration of simulation [s]."""

    seed: int
    item_type: str
    outcome: str
    item: str = ""
    attempts: str = ""
    detection: str = ""
    place: str = ""
    others: str = ""
    duration: str = ""
    real_time: str = ""


def sell(seed: int, settings: Sequence[str], out: Path) -> Sale:
    """Run one sale from a stock of its own."""
    item_type = TYPES[seed % len(TYPES)]
    wanted = [f"plant.params.stock.seed={seed}", f"mission.params.orders=[{item_type}]", *settings]
    result = run(load("store", wanted), Options(out=out))
    row = _ROW.search(summary(out / "run.mcap"))
    if result.exit_code or row is None:
        return Sale(seed, item_type, result.reason)
    return Sale(
        seed, item_type, "sold", **row.groupdict(), real_time=f"{result.real_time_factor:.1f}"
    )


def summary(log: Path) -> str:
    """Return what the mission says at the end."""
    with log.open("rb") as file:
        messages = make_reader(file).iter_messages(topics=["mission/summary"])
        return "\n".join(msgspec.msgpack.decode(message.data)["text"] for _, _, message in messages)


def table(sales: Sequence[Sale]) -> str:
    """Return the sales as a table in Markdown."""
    header = Sale._fields
    rows = [header, ("---",) * len(header), *(tuple(map(str, sale)) for sale in sales)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main() -> int:
    """Print the table; exit with 1 where fewer than 95 % were sold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="how many stocks (default: 20)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first one")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    args = parser.parse_args()
    sales: list[Sale] = []
    for seed in range(args.first, args.first + args.seeds):
        with tempfile.TemporaryDirectory(prefix="stepbus-store-") as folder:
            sales.append(sell(seed, args.settings, Path(folder) / "run"))
        print(" ".join(map(str, sales[-1])), file=sys.stderr, flush=True)
    sold = sum(sale.outcome == "sold" for sale in sales)
    print(table(sales))
    print(f"\n{sold} of {len(sales)} sold")
    return 0 if sold >= 0.95 * len(sales) else 1


if __name__ == "__main__":
    raise SystemExit(main())
