"""What gets in the way of a sale: seeded, one family after the other."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from stepbus_participant import package_path
from stepbus_plant.world_file import Item, load_world

from . import obstacles
from .obstacles import Action, put

_TYPES = ("cola", "juice", "water", "soup")
_HEIGHTS = {"cola": 0.116, "juice": 0.121, "water": 0.151, "soup": 0.101}
"""Where something stands on an item, above its lower end [m]."""
_KILLABLE = ("perception", "mission", "controller", "planner")
_ARM = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
    "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
)  # fmt: skip

_WHEELS, _FINGERS = ("left_wheel", "right_wheel"), ("left_finger", "right_finger")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One sale. script: of the plant. fault: of `--fault`."""

    number: int
    family: str
    scenario: str = "store/truth"
    seed: int = 0
    order: str = "cola"
    script: Sequence[Action] = field(default_factory=list)
    fault: str = ""
    engine: str = "pybullet"

    @property
    def killed(self) -> str:
        """Return the participant that is killed; empty: none."""
        words = self.fault.split()
        return words[1] if words[:1] == ["kill"] else ""

    def __str__(self) -> str:
        """Return the case in words."""
        what = self.fault or "; ".join(map(json.dumps, self.script[:3])) or "undisturbed"
        where = f"{self.scenario}, stock {self.seed}, {self.order}"
        return f"#{self.number} {self.family}: {where}; {what}"

    def arguments(self) -> list[str]:
        """Return the arguments of `stepbus run`."""
        words = [
            self.scenario,
            *("--set", f"plant.params.engine={self.engine}"),
            *("--set", f"plant.params.stock.seed={self.seed}"),
            *("--set", f"mission.params.orders=[{self.order}]"),
            # What is JSON is YAML.
            *("--set", f"plant.params.script={json.dumps(self.script)}"),
        ]
        faults = ["--fault", self.fault] if self.fault else []
        return [*words, *faults, *([] if self.killed else ["--in-process"])]


def cases(seed: int, count: int) -> list[Case]:
    """Return the cases, every family in turn."""
    names, rows = list(FAMILIES), []
    for number in range(count):
        family = names[number % len(names)]
        chance = random.Random(f"store {seed} {number}")
        sale = {"seed": chance.randrange(10_000), "order": chance.choice(_TYPES)}
        given = FAMILIES[family](chance, {**sale, "round": number // len(names)})
        rows.append(Case(number=number, family=family, **{**sale, **given}))
    return rows


def _arm_posts(chance: random.Random, _: Mapping[str, Any]) -> dict[str, Any]:
    """Put the post near the shelf before the arm gets there."""
    at = chance.choice([0.0, chance.uniform(2.8, 3.8), chance.uniform(4.0, 5.8)])
    x, y = chance.uniform(1.95, 2.1), chance.uniform(-0.5, 0.6)
    return {"script": [put("pillar", at, x, y, z=chance.choice([0.0, chance.uniform(0.2, 0.5)]))]}


def _outlet_posts(chance: random.Random, _: Mapping[str, Any]) -> dict[str, Any]:
    """Put the post beside the outlet while the arm swings there, or leaves it."""
    if chance.random() < 0.7:
        late = chance.uniform(0.0, 1.0)
        # The wrist comes along here a little later, while the base still drives.
        x, y = 0.83 - 0.8 * late + chance.uniform(-0.1, 0.1), chance.uniform(0.5, 0.72)
        return {"scenario": "store", "script": [put("pillar", 9.6 + late, x, y)]}
    x, y = chance.uniform(0.22, 0.4), chance.uniform(0.4, 0.58)
    height = -chance.uniform(0.45, 0.6)
    script = [put("pillar", chance.uniform(13.1, 13.7), x, y, z=height)]
    return {"scenario": "store", "script": script}


@cache
def _items(seed: int) -> Mapping[str, Item]:
    folder = package_path("package://stepbus_store/scenarios/store")
    return load_world(folder / "world.yaml", {"seed": seed}).items


def _first(common: Mapping[str, Any]) -> Item:
    """Return the item that is sold, which is the first one of its type."""
    rows = _items(common["seed"]).values()
    return next(item for item in rows if item.type == common["order"])


def _deeper(chance: random.Random, common: Mapping[str, Any]) -> dict[str, Any]:
    """Push the item deeper into the shelf, towards the next tier."""
    item, deeper = _first(common), chance.uniform(0.005, 0.022)
    x, y, z = item.position
    c, s = math.cos(item.yaw), math.sin(item.yaw)
    return {"script": [put(item.name, 0.2, x + c * deeper, y + s * deeper, z=z, yaw=item.yaw)]}


def _turned(chance: random.Random, common: Mapping[str, Any]) -> dict[str, Any]:
    """Turn the item on its place, and a little out of it."""
    item = _first(common)
    x, y, z = item.position
    dx, dy = (chance.uniform(-0.008, 0.008) for _ in range(2))
    yaw = item.yaw + chance.uniform(-0.5, 0.5)
    return {"script": [put(item.name, 0.2, x + dx, y + dy, z=z, yaw=yaw)]}


def _lying(chance: random.Random, common: Mapping[str, Any]) -> dict[str, Any]:
    """Lay the item down on its place, in any direction."""
    item = _first(common)
    x, y, z = item.position
    heading = chance.uniform(-math.pi, math.pi)
    # The origin of an item is its lower end.
    x, y = x - 0.05 * math.cos(heading), y - 0.05 * math.sin(heading)
    action = {
        **put(item.name, 0.2, x, y, z=z + 0.036),
        "orientation_rpy": [0, math.pi / 2, heading],
    }
    return {"scenario": "store", "script": [action]}


def _hidden(chance: random.Random, common: Mapping[str, Any]) -> dict[str, Any]:
    """Put another item onto the one that is ordered."""
    item = _first(common)
    x, y, z = item.position
    above = next(name for name, row in _items(common["seed"]).items() if row.type != item.type)
    action = put(above, 0.2, x + chance.uniform(-0.01, 0.01), y, z=z + _HEIGHTS[item.type])
    return {"scenario": "store", "script": [action]}


def _shelf(chance: random.Random, _: Mapping[str, Any]) -> dict[str, Any]:
    """Move the shelf, but not what stands on it."""
    dx, dy = chance.uniform(-0.015, 0.015), chance.uniform(-0.03, 0.03)
    yaw = chance.uniform(-0.02, 0.02)
    return {"script": [put("shelf_a", 0.1, 1.95 + dx, dy, yaw=yaw)]}


def _kill(chance: random.Random, _: Mapping[str, Any]) -> dict[str, Any]:
    return {"fault": f"kill {chance.choice(_KILLABLE)} at {chance.randrange(20, 900)}"}


def _jam(chance: random.Random, common: Mapping[str, Any]) -> dict[str, Any]:
    """Jam each joint of the arm, each wheel and each finger in turn, at any time."""
    joints = (*_ARM, *_WHEELS, *_FINGERS)
    joint = joints[common["round"] % len(joints)]
    return {"script": [{"at": f"{chance.uniform(0.5, 13.0):.3f}s", "jam": joint}]}


def _camera(chance: random.Random, _: Mapping[str, Any]) -> dict[str, Any]:
    """Block the camera, for good or for some seconds."""
    at, length = chance.uniform(0.5, 6.0), chance.uniform(0.5, 3.0)
    script: list[Action] = [{"at": f"{at:.3f}s", "camera": "camera"}]
    if chance.random() < 0.5:
        script.append({"at": f"{at + length:.3f}s", "camera": "camera", "off": False})
    return {"scenario": "store", "script": script}


def _stop(chance: random.Random, _: Mapping[str, Any]) -> dict[str, Any]:
    """Stop everything at any time, and release it some seconds later."""
    at, length = chance.uniform(0.3, 13.5), chance.uniform(0.3, 4.0)
    script: list[Action] = [
        {"at": f"{at:.3f}s", "emergency_stop": True},
        {"at": f"{at + length:.3f}s", "emergency_stop": False},
    ]
    return {"scenario": chance.choice(["store", "store/truth"]), "script": script}


def _lost(chance: random.Random, _: Mapping[str, Any]) -> dict[str, Any]:
    """Lose a message that others wait for."""
    who = chance.choice(["plant", "controller", "mission"])
    return {"fault": f"drop {who} at {chance.randrange(20, 800)}"}


def _nothing(_: random.Random, common: Mapping[str, Any]) -> dict[str, Any]:
    """Leave the robot alone, with either engine in turn."""
    return {"engine": ("pybullet", "mujoco")[common["round"] % 2]}


FAMILIES: Mapping[str, Callable[[random.Random, Mapping[str, Any]], dict[str, Any]]] = {
    "a post on the way out": obstacles.post_out,
    "a post on the way home": obstacles.post_home,
    "a post at the goal": obstacles.post_at_goal,
    "somebody crosses": obstacles.crossing,
    "somebody follows": obstacles.following,
    "somebody stands": obstacles.standing,
    "somebody turns back": obstacles.turning,
    "posts at the shelf": _arm_posts,
    "deeper item": _deeper,
    "turned item": _turned,
    "lying item": _lying,
    "hidden item": _hidden,
    "moved shelf": _shelf,
    "killed participant": _kill,
    "jammed joint": _jam,
    "blocked camera": _camera,
    "posts at the outlet": _outlet_posts,
    "emergency stop": _stop,
    "lost message": _lost,
    "undisturbed": _nothing,
}
