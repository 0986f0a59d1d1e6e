"""Bodies that a class of one's own adds to a world."""

import pytest
from support.services.devices import write_can

from stepbus_plant import load_world
from stepbus_schemas import WiringError

PARTS = """
from types import SimpleNamespace

from stepbus_participant import ModelFile, Settings


class World(Settings):
    urdf: ModelFile


class Params(Settings):
    mass: float = 1.0


class Parts:
    World, Params = World, Params

    def __init__(self, world, params, seed):
        self.world, self.params, self.seed = world, params, seed

    def items(self, problems):
        if self.params.mass > 5:
            problems.add(("mass",), "is too much")
        place = dict(position=(0.1 * self.seed, 0.0, 0.0), yaw=0.0, slot=(0.0, 0.0, 0.0), slot_yaw=0.0)
        part = SimpleNamespace(name="part", type="can", urdf=self.world.urdf, mass=self.params.mass)
        vars(part).update(place, friction=0.5, spinning_friction=0.0)
        return [part]
"""
WORLD = """
bodies: {floor: {urdf: can.urdf}}
stock: {source: "parts.py:Parts", urdf: can.urdf}
"""


def load(folder, params=None, text=WORLD, seed=0):
    write_can(folder)
    (folder / "parts.py").write_text(PARTS)
    (folder / "world.yaml").write_text(text)
    return load_world(folder / "world.yaml", params, seed=seed)


def test_a_class_beside_the_world_file_adds_a_body(tmp_path):
    world = load(tmp_path, {"mass": 2.0}, seed=3)
    assert list(world.bodies) == ["floor", "part"]
    assert world.bodies["part"].position == pytest.approx((0.3, 0.0, 0.0))
    assert world.items["part"].mass == 2.0


@pytest.mark.parametrize(
    ("params", "old", "new", "sentence"),
    [
        ({"mass": 9.0}, "", "", "params.stock.mass: is too much"),
        ({"mas": 1.0}, "", "", "params.stock.mas: unknown key 'mas'; did you mean 'mass'?"),
        (None, "urdf: can.urdf}\n", "urdf: no.urdf}\n", "world.yaml:3: stock.urdf: file 'no.urdf' not found"),
        (None, "floor", "part", "world.yaml:3: stock: 'part' names two bodies"),
        (None, "parts.py:Parts", "parts.py:Part", "world.yaml:3: stock.source: "),
        (None, "parts.py:Parts", "../parts.py:Parts", "must be a class in a file beside the world file"),
        (None, "parts.py:Parts", "json:JSONDecoder", "or in a package that declares participants"),
        ({}, WORLD.splitlines()[2], "", "params.stock: this world has no stock"),
    ],
)  # fmt: skip
def test_mistakes_are_named_with_their_place(tmp_path, params, old, new, sentence):
    text = WORLD.replace(old, new)
    with pytest.raises(WiringError) as caught:
        load(tmp_path, params, text)
    assert sentence in str(caught.value)
