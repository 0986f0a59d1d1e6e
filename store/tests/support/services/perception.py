"""Shelves full of items, seen by the plant's own camera."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from stepbus_models import read_robot
from stepbus_plant.camera import Camera, Lens
from stepbus_plant.engine import BASE, Engine, Loading
from stepbus_plant.engines import default_engine, open_engine
from stepbus_plant.geometry import quaternion
from stepbus_plant.models import loadable
from stepbus_plant.params import CameraErrors
from stepbus_plant.world import CameraSettings
from stepbus_schemas import Description, Image, Poses
from stepbus_store.solids import rotation

UPRIGHT = "0 0 0 0 0 0 1"
SHAPES = {
    "cola": "cylinder 0.033 0.115 @ 0 0 0 0 0 0 1",
    "juice": "box 0.06 0.06 0.12 @ 0 0 0 0 0 0 1",
    "water": "cylinder 0.032 0.1 @ 0 0 -0.025 0 0 0 1; cylinder 0.015 0.05 @ 0 0 0.05 0 0 0 1",
    "soup": "cylinder 0.035 0.1 @ 0 0 0 0 0 0 1",
    "cereal": "box 0.05 0.08 0.1 @ 0 0 0 0 0 0 1",
}
COLORS = {
    "cola": (0.8, 0.1, 0.1),
    "juice": (0.1, 0.6, 0.2),
    "water": (0.1, 0.3, 0.8),
    "soup": (0.9, 0.75, 0.1),
    "cereal": (0.8, 0.4, 0.1),
}
TOPS = {"cola": 0.0575, "juice": 0.06, "water": 0.075, "soup": 0.05, "cereal": 0.05}
"""Height of the top above the item's origin [m]."""
WOOD = (0.6, 0.5, 0.4)

_URDF = """<robot name="{name}"><link name="{name}"><inertial><mass value="0.3"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>{parts}</link></robot>"""
_PART = """<visual><origin xyz="{xyz}"/><geometry>{geometry}</geometry>
<material name="{name}"><color rgba="{color} 1"/></material></visual>"""


@dataclass(frozen=True)
class Item:
    name: str
    type: str
    position: tuple[float, float, float]
    yaw: float = 0.0

    @property
    def orientation(self) -> tuple[float, float, float, float]:
        return (0.0, 0.0, math.sin(self.yaw / 2), math.cos(self.yaw / 2))


@dataclass
class Store:
    """Items on boards, and a camera that can be put anywhere."""

    folder: Path
    engine: Engine
    width: int = 320
    height: int = 240
    items: list[Item] = field(default_factory=list)
    rest: list[str] = field(default_factory=list)
    lens: Lens | None = None

    def __post_init__(self) -> None:
        path = self.folder / "camera.urdf"
        path.write_text(_URDF.format(name="camera", parts=""), encoding="utf-8")
        self._camera = load_fixed(self.engine, path, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        row = CameraSettings(
            link="camera", period_ns=8_000_000, width=self.width, height=self.height
        )
        lens = self.lens or Lens(CameraErrors(), 0)
        self._sensor = Camera("camera", row, (self._camera, BASE), self.engine, lens)
        self._views = 0

    def add(self, item: Item) -> None:
        self._load(item.type, SHAPES[item.type], COLORS[item.type], item.position, item.yaw)
        self.items.append(item)

    def lay(self, kind: str, at: tuple[float, float, float], heading: float) -> None:
        """Put something down that looks like an item, with its axis along a heading [rad]."""
        self._load(kind, SHAPES[kind], COLORS[kind], at, heading, math.pi / 2)
        self.rest.append("lying")

    def board(self, size: tuple[float, float, float], at: tuple[float, float, float]) -> None:
        # The engine keeps the shapes of a file that it knows.
        self._load(
            f"board_{len(self.rest)}", "box {} {} {} @ {}".format(*size, UPRIGHT), WOOD, at, 0.0
        )
        self.rest.append("board")

    def _load(self, name, shapes, color, position, yaw, pitch=0.0) -> None:
        path = self.folder / f"{name}.urdf"
        parts = "".join(_visual(name, text, color) for text in shapes.split(";"))
        path.write_text(_URDF.format(name=name, parts=parts), encoding="utf-8")
        load_fixed(self.engine, path, position, (0.0, pitch, yaw))

    def look(self, position, yaw: float = 0.0, tilt=(0.0, 0.0)) -> tuple[dict[str, Image], pin.SE3]:
        """Return what a camera sees that looks down, turned by yaw and tilted about x, y."""
        down = quaternion((math.pi + tilt[0], tilt[1], yaw))
        return self.see(position, down), pin.SE3(rotation(down), np.array(position))

    def see(self, position, orientation) -> dict[str, Image]:
        """Return what a camera sees from a pose of its optical frame."""
        self.engine.put(self._camera, (tuple(position), tuple(orientation)))
        self._views += 1
        rgb, depth = self._sensor.render(self._views)
        return {"rgb": rgb, "depth": depth}

    @property
    def description(self) -> Description:
        colors = [*(COLORS[item.type] for item in self.items), *(WOOD for _ in self.rest)]
        return Description(
            names=["chassis", *(item.name for item in self.items), *self.rest],
            details={
                "type": ["", *(item.type for item in self.items), *("" for _ in self.rest)],
                "shape": [
                    "",
                    *(SHAPES[item.type] for item in self.items),
                    *("mesh" for _ in self.rest),
                ],
                "color": ["", *(" ".join(map(str, color)) for color in colors)],
                "body": ["", *(item.name for item in self.items), *self.rest],
            },
        )

    def poses(self, chassis=(0.0, 0.0, 0.0), yaw: float = 0.0) -> Poses:
        here = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        rest = len(self.rest)
        return Poses(
            position=[chassis, *(item.position for item in self.items), *[(0, 0, 0)] * rest],
            orientation=[here, *(item.orientation for item in self.items), *[(0, 0, 0, 1)] * rest],
        )


def _visual(name: str, text: str, color: tuple[float, float, float]) -> str:
    shape, _, place = text.partition("@")
    word, *sizes = shape.split()
    geometry = (
        f'<box size="{" ".join(sizes)}"/>'
        if word == "box"
        else f'<cylinder radius="{sizes[0]}" length="{sizes[1]}"/>'
    )
    xyz = " ".join(place.split()[:3])
    return _PART.format(xyz=xyz, geometry=geometry, name=name, color=" ".join(map(str, color)))


def load_fixed(engine: Engine, urdf: Path, position, rpy) -> int:
    """Return the number of a body that stands somewhere and looks as its model says."""
    pose = tuple(position), quaternion(rpy)
    return engine.load(loadable(read_robot(urdf)), pose, Loading(is_fixed=True))


def empty_world() -> Engine:
    """Return the engine that is the default here, with nothing in it."""
    return open_engine(default_engine(), 1e-3, (0.0, 0.0, 0.0), 50)


@contextmanager
def open_store(
    folder: Path, *items: Item, lens: Lens | None = None, **size: int
) -> Iterator[Store]:
    """Yield a store with some items; lens: of its camera."""
    with closing(empty_world()) as engine:
        store = Store(folder, engine, lens=lens, **size)
        for item in items:
            store.add(item)
        yield store


def fill_shelves(store: Store, seed: int = 7) -> None:
    """Put 42 mixed items on the three tiers of two shelves, jittered by a few mm and degrees."""
    random = np.random.default_rng(seed)
    kinds = ("cola", "juice", "water", "soup")
    for shelf, front in (("a", 0.4), ("b", 1.4)):
        for tier, level in enumerate((0.20, 0.35, 0.50)):
            x = front + 0.065 + 0.13 * tier
            store.board((0.13, 0.75, level), (x, 0.0, level / 2))
            for column in range(7):
                kind = kinds[random.integers(4)]
                dx, dy, turn = random.uniform(-1, 1, 3) * (0.004, 0.004, 0.15)
                bottom = {"water": 0.075}.get(kind, TOPS[kind])
                place = (x + dx, 0.1 * (column - 3) + dy, level + bottom)
                store.add(Item(f"{kind}_{shelf}{tier}_{column}", kind, place, turn))


JOINTS = [f"joint_{n}" for n in range(6)]
_LINK = """<link name="link_{n}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint_{n}" type="revolute"><parent link="{parent}"/><child link="link_{n}"/>
<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>"""


def write_robot(folder: Path) -> Path:
    """Return a URDF: an arm of six joints on a chassis, a camera at its end."""
    axes = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "1 0 0")
    links = "".join(
        _LINK.format(
            n=n,
            parent=f"link_{n - 1}" if n else "chassis",
            xyz="0.05 0 0.2" if n < 3 else "0.05 0.01 -0.02",
            rpy="0 0.1 0" if n == 4 else "0 0 0",
            axis=axis,
        )
        for n, axis in enumerate(axes)
    )
    wheel = (
        '<link name="wheel"/><joint name="wheel" type="continuous"><parent link="chassis"/>'
        '<child link="wheel"/><axis xyz="0 1 0"/></joint>'
    )
    camera = (
        '<link name="camera"/><joint name="mount" type="fixed"><parent link="link_5"/>'
        '<child link="camera"/><origin xyz="0.05 0 0.03" rpy="3.0 0.1 -1.4"/></joint>'
    )
    path = folder / "robot.urdf"
    path.write_text(
        f'<robot name="robot"><link name="chassis"/>{wheel}{links}{camera}</robot>',
        encoding="utf-8",
    )
    return path
