"""Goods on shelves."""

import re

import pytest
from support.services.devices import box, link, write_can, write_urdf
from support.tools import needs_pybullet

from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_plant.engine import BASE
from stepbus_plant.poses import Planogram, PoseSensor
from stepbus_schemas import WiringError

STOCK = """
sleeping: true
bodies:
  shelf: {urdf: shelf.urdf, fixed_base: true, position: [0, 0, 0.5]}
stock:
  source: stepbus_store.stock:Stock
  types:
    can: {urdf: can.urdf, mass: 0.35}
    carton: {urdf: carton.urdf, mass: 0.4, friction: 0.5}
  rows:
    a: {position: [0.0, 0, 0.5], yaw: 0, count: 6, pitch: 0.1}
    b: {position: [0.2, 0, 0.5], yaw: 1.5707963267948966, count: 2, pitch: 0.1}
"""


def load(folder, stock=None, text=STOCK, seed=0):
    write_can(folder)
    write_urdf(folder, "carton", link("carton", 0.4, box("0.06 0.06 0.12"), "0 0 0.06"))
    write_urdf(folder, "shelf", link("board", 1.0, box("1 1 1"), "0 0 -0.5"))
    (folder / "world.yaml").write_text(text)
    return load_world(folder / "world.yaml", stock, seed=seed)


def items(folder, **stock):
    return load(folder, stock).items


def refusal(folder, stock=None, text=STOCK):
    with pytest.raises(WiringError) as caught:
        load(folder, stock, text)
    return str(caught.value)


def test_every_slot_has_an_item_and_all_types_are_equally_frequent(tmp_path):
    world = load(tmp_path)
    assert [name.split("_", 1)[1] for name in world.items] == [
        *(f"a_{n}" for n in range(1, 7)), "b_1", "b_2",
    ]  # fmt: skip
    assert sorted(item.type for item in world.items.values()) == ["can"] * 4 + ["carton"] * 4


def test_slots_are_counted_from_left_to_right_as_seen_from_the_front(tmp_path):
    text = STOCK + "  spread: {position: 0, yaw: 0, mass: 0, friction: 0}\n"
    found = load(tmp_path, text=text).items.values()
    at = {item.name.split("_", 1)[1]: item.position for item in found}
    assert at["a_1"] == pytest.approx((0.0, 0.25, 0.5))
    assert at["b_2"] == pytest.approx((0.25, 0.0, 0.5))


def test_the_same_seed_gives_the_same_items_and_another_one_others(tmp_path):
    assert items(tmp_path, seed=3) == items(tmp_path, seed=3)
    assert items(tmp_path, seed=3) != items(tmp_path, seed=4)


def test_what_is_missing_leaves_all_else_as_it_is(tmp_path):
    every = items(tmp_path)
    can = next(name for name, item in every.items() if item.type == "can")
    some = items(tmp_path, missing=[can, "a_5", "b"])
    gone = every.keys() - some.keys()
    assert gone == {can, *(n for n in every if n.endswith(("_a_5", "_b_1", "_b_2")))}
    assert all(every[name] == item for name, item in some.items())


def test_a_kind_can_be_missing_and_shelves_half_full(tmp_path):
    assert {item.type for item in items(tmp_path, missing=["can"]).values()} == {"carton"}
    assert len(items(tmp_path, fill=0.5)) == 4
    assert items(tmp_path, fill=0.0) == {}


def heavy_cans(folder, **more):
    """Return a plant whose cans weigh 9 kg and are slippery, the number of one, and its item."""
    stock = {"seed": 1, "types": {"can": {"mass": 9, "friction": 0.05}}}
    params = Params.of({"world": "world.yaml", "stock": stock, **more})
    plant = SimulatedPlant(load(folder, params.stock), params, 4_000_000, 0)
    world = plant.world
    number, item = next(
        (n, world.items[name])
        for n, name in enumerate(world.bodies)
        if name in world.items and world.items[name].type == "can"
    )
    return plant, number, item


def test_params_change_mass_and_friction_of_a_type(tmp_path):
    plant, number, item = heavy_cans(tmp_path)
    assert plant.physics.engine.mass((number, BASE)) == pytest.approx(item.mass)
    assert item.mass == pytest.approx(9, rel=0.03)
    assert item.friction == pytest.approx(0.05, rel=0.05)


@needs_pybullet
def test_a_changed_mass_scales_the_inertia(tmp_path):
    bullet = pytest.importorskip("pybullet")
    plant, number, item = heavy_cans(tmp_path, engine="pybullet")
    mass, friction, inertia = bullet.getDynamicsInfo(number, -1, plant.physics.engine.client)[:3]
    assert (mass, friction) == pytest.approx((item.mass, item.friction))
    assert inertia[0] == pytest.approx(0.001 * mass)  # as in the URDF of support.services.devices


def test_a_body_its_link_and_its_type_are_named_after_the_item(tmp_path):
    plant = SimulatedPlant(load(tmp_path), Params(world="world.yaml"), 4_000_000, 0)
    said = PoseSensor(plant.physics).description
    assert said.names == ["board", *plant.world.items]
    assert said.details["type"] == ["", *(item.type for item in plant.world.items.values())]


@needs_pybullet
def test_goods_on_a_shelf_sleep_from_the_start(tmp_path):
    early, late = (_carton(tmp_path, 0.5, steps, engine="pybullet") for steps in (5, 100))
    assert early == late
    assert early[0][2] == pytest.approx(0.56, abs=1e-4)


def test_goods_in_the_air_fall_first(tmp_path):
    assert _carton(tmp_path, 0.6, 100)[0][2] == pytest.approx(0.56, abs=1e-3)


def _carton(folder, height, steps, **params):
    """Return the pose of a carton on a board whose top is at 0.5 m, after some steps."""
    text = STOCK.replace("    can: {urdf: can.urdf, mass: 0.35}\n", "")
    text = text.replace("position: [0.0, 0, 0.5], yaw", f"position: [0.0, 0, {height}], yaw")
    params = Params(world="world.yaml", **params)
    plant = SimulatedPlant(load(folder, text=text), params, 4_000_000, 0)
    for _ in range(steps):
        plant.advance()
    number = list(plant.world.bodies).index("carton_a_1")
    pose = plant.physics.engine.centre(number)
    plant.close()
    return pose


def test_unknown_names_in_the_params_are_refused_with_the_nearest(tmp_path):
    given = {"types": {"cann": {"mass": 1}}, "missing": ["a_7"]}
    assert refusal(tmp_path, given).splitlines() == [
        "params.stock.types.cann: unknown item type 'cann'; did you mean 'can'?",
        "params.stock.missing: 'a_7' is unknown; did you mean 'a_6'?",
    ]


def test_params_for_a_world_without_a_stock_are_refused(tmp_path):
    text = "bodies: {shelf: {urdf: shelf.urdf}}"
    assert refusal(tmp_path, {}, text) == "params.stock: this world has no stock"


def test_mistakes_of_a_stock_are_listed_with_their_lines(tmp_path):
    text = STOCK.replace("mass: 0.35", "mas: 0.35").replace("carton.urdf", "gone.urdf")
    told = refusal(tmp_path, text=text)
    assert "world.yaml:8: stock.types.can.mas: unknown key 'mas'; did you mean 'mass'?" in told
    assert "world.yaml:9: stock.types.carton.urdf: file 'gone.urdf' not found" in told


def test_an_item_that_is_called_like_another_body_is_refused(tmp_path):
    name = next(iter(load(tmp_path).items))
    told = refusal(tmp_path, text=STOCK.replace("  shelf:", f"  {name}:"))
    assert f"world.yaml:5: stock: '{name}' names two bodies" in told


def test_a_kind_or_a_row_is_needed(tmp_path):
    text = (
        STOCK[: STOCK.index("stock:")]
        + "stock: {source: 'stepbus_store.stock:Stock', types: {}, rows: {}}"
    )
    told = refusal(tmp_path, text=text)
    assert "stock.types: is empty" in told
    assert "stock.rows: is empty" in told


@pytest.mark.parametrize(
    ("mass", "sentence"),
    [
        ("0", "an item must be one link with a mass above 0"),
        ("-1", "value='-1' of <mass> must be"),
        ("nan", "value='nan' of <mass> must be a finite"),
        ("heavy", "value='heavy' of <mass> must be a finite"),
    ],
)
def test_a_kind_whose_mass_cannot_be_scaled_is_refused_with_its_line(tmp_path, mass, sentence):
    world = load(tmp_path)
    urdf = tmp_path / "can.urdf"
    urdf.write_text(re.sub(r'<mass value="[^"]*"', f'<mass value="{mass}"', urdf.read_text()))
    with pytest.raises(WiringError) as caught:
        SimulatedPlant(world, Params(world="world.yaml"), 8_000_000, 0)
    told = str(caught.value).splitlines()
    assert len(told) == 4
    assert all(sentence in line for line in told)


def test_a_planogram_has_the_slots_to_the_centimetre(tmp_path):
    text = STOCK.replace("[0.0, 0, 0.5]", "[0.004, 0, 0.5]")
    world = load(tmp_path, text=text)
    plant = SimulatedPlant(world, Params(world="world.yaml"), 8_000_000, 0)
    sensor = PoseSensor(plant.physics)
    true, plan = sensor.sense(), Planogram(sensor, world.items).sense(0)
    for name, truth, place in zip(sensor.names, true.position, plan.position, strict=True):
        if name in world.items:
            assert place[:2] == tuple(round(value, 2) for value in place[:2])
            assert place != truth
            assert place == pytest.approx(truth, abs=0.005 + 0.003 + 1e-6)
        else:
            assert place == truth
    plant.close()


def test_the_seed_of_a_run_draws_the_stock_where_it_is_asked_to(tmp_path):
    stock = {"seed": "run"}
    first, again, other = (load(tmp_path, stock, seed=seed).items for seed in (1, 1, 2))
    assert first == again == load(tmp_path, {"seed": 1}).items != other
    assert load(tmp_path, {"seed": 3}, seed=1).items == load(tmp_path, {"seed": 3}).items
