"""How precise a sale was, by the true poses: metrics for a sweep over stocks. Lengths [mm].

stepbus sweep store --vary plant.params.stock.seed=0:9:10 --set 'mission.params.orders=[water]' \
    --metric store/scripts/sales.py:place --metric store/scripts/sales.py:others \
    --metric store/scripts/sales.py:drift
"""

import math
from typing import Any

import numpy as np

from stepbus import Recording


def _poses(recording: Recording) -> tuple[list[str], Any]:
    """Return the names of the bodies, and their positions, shape (steps, n, 3) [m]."""
    port = recording["plant.poses"]
    return list(port.names), port["position"].reshape(len(port), -1, 3)


def _sold(recording: Recording) -> int:
    """Return the number of the body that went farthest, of those that are items."""
    types = recording["plant.poses"].description.details["type"]
    _, rows = _poses(recording)
    moved = np.linalg.norm(rows[-1] - rows[0], axis=1)
    return int(np.argmax(np.where([bool(kind) for kind in types], moved, 0.0)))


def place(recording: Recording) -> float:
    """Return the distance of the item from the middle of the scenario's outlet."""
    outlet = recording.scenario["participants"]["mission"]["params"]["outlet"]["position"]
    _, rows = _poses(recording)
    return 1e3 * math.dist(rows[-1, _sold(recording), :2], outlet[:2])


def others(recording: Recording) -> float:
    """Return the largest displacement of another item."""
    types = recording["plant.poses"].description.details["type"]
    _, rows = _poses(recording)
    moved = np.linalg.norm(rows[-1] - rows[0], axis=1)
    moved[_sold(recording)] = 0.0
    return 1e3 * float(moved[[bool(kind) for kind in types]].max())


def drift(recording: Recording) -> float:
    """Return the error of the base's pose on the map at the end."""
    names, rows = _poses(recording)
    pose = recording["world.pose" if "world.pose" in recording else "plant.odometry"]
    base = rows[-1, names.index("chassis")]
    return 1e3 * math.hypot(pose["x"][-1] - base[0], pose["y"][-1] - base[1])
