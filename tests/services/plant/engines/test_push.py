"""Pushes beside the closed form on each engine: impulse is the change of momentum."""

import math

import numpy as np
import pytest
from support.services.control import Stand, make_config
from support.services.devices import write_base
from support.services.mechanics import (
    FLOOR,
    MS,
    ROD,
    ROD_MOMENT,
    Row,
    advance,
    box_inertia,
    fixed,
    link,
    make,
    robot,
    state,
    velocity,
)

from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import CallError
from stepbus_plant import Params, Plant, SimulatedPlant, load_world
from stepbus_plant.commander import CommandError
from stepbus_plant.engine import BASE
from stepbus_plant.geometry import quaternion, rotation
from stepbus_schemas import Description, WiringError, Wrench

RPY = (0.3, -0.7, 1.1)
INERTIA = (0.04, 0.05, 0.07)
CLUB = Row(
    robot(link("head", 2.0, INERTIA, centre="0.3 0 0.1")),
    f"position: [5, 3, 2], orientation_rpy: {list(RPY)}",
)
DRIFT = "gravity: [0, 0, 0]"
NEAR = {"rel": 1e-6, "abs": 1e-6}


def pushed(folder, engine, bodies, *pushes, world=DRIFT, step_ns=MS, steps=200, **params):
    """Return a plant after some steps of 1 ms, and what it has told."""
    script = [{"at": "10ms", "over": "100ms", **push} for push in pushes]
    plant = make(folder, engine, bodies, world, step_ns, script=script, **params)
    return advance(plant, steps)


def spin(plant):
    return np.array(plant.physics.engine.motion((0, BASE)).spin)


@pytest.mark.parametrize("frame", ["world", "link"])
def test_a_free_body_takes_up_the_impulse_of_a_force(tmp_path, engine, frame):
    push = {"push": "club", "force": [3, -4, 5], "frame": frame}
    plant = pushed(tmp_path, engine, {"club": CLUB}, push)
    turn = rotation(plant.physics.engine.frame((0, BASE))[1]) if frame == "link" else np.eye(3)
    assert velocity(plant, "club") == pytest.approx(turn @ (3, -4, 5) * 0.1 / 2, **NEAR)
    assert spin(plant) == pytest.approx((0, 0, 0), abs=1e-6)
    assert plant.script.events == [
        "at 0.01 s: club is pushed with 3, -4, 5 N"
        + " in its frame" * (frame == "link")
        + " for 100ms"
    ]


@pytest.mark.parametrize("frame", ["world", "link"])
def test_a_point_and_a_torque_turn_a_free_body_about_its_centre(tmp_path, engine, frame):
    push = {"force": [30, -40, 50], "torque": [1, 2, -3], "point": [0.5, 0.2, 0], "frame": frame}
    # Within one substep, it does not turn yet: angular momentum is r x F t + T t.
    once = {"push": "head", "over": "1ms", **push}
    plant = pushed(tmp_path, engine, {"club": CLUB}, once, steps=11)
    turn = rotation((0.0, 0.0, 0.0, 1.0)) if frame == "link" else rotation(quaternion(RPY)).T
    force, torque = turn @ push["force"], turn @ push["torque"]
    expected = (np.cross((0.2, 0.2, -0.1), force) + torque) * 1e-3 / INERTIA
    own = rotation(quaternion(RPY)).T @ spin(plant)
    assert own == pytest.approx(expected, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize(
    ("push", "torque"),
    [
        ({"force": [0, 0, -2], "frame": "link"}, 1.0),
        ({"force": [0, 0, -2], "frame": "link", "point": [1, 0, 0]}, 2.0),
        ({"torque": [5, 0.3, -7]}, 0.3),
    ],
)
def test_a_pendulum_takes_up_the_moment(tmp_path, engine, push, torque):
    plant = pushed(tmp_path, engine, {"rod": fixed(ROD)}, {"push": "rod", **push})
    assert state(plant, "hinge")[1] == pytest.approx(torque * 0.1 / ROD_MOMENT, **NEAR)


@pytest.mark.parametrize(("floor", "off"), [(0.0, {}), (1.0, {"mujoco": 2e-5})])
def test_a_base_takes_up_the_impulse_slipping_or_rolling(tmp_path, engine, floor, off):
    write_base(tmp_path)
    friction = f"friction: {{lateral: {floor}}}"
    wheels = "" if floor else f", {friction}"
    path = tmp_path / "world.yaml"
    path.write_text(
        f"bodies:\n  ground: {{urdf: ground.urdf, fixed_base: true, {friction}}}\n"
        f"  base: {{urdf: base.urdf, position: [0, 0, 0.1]{wheels}}}\n"
    )
    push = {"at": "500ms", "push": "base", "force": [60, 0, 0], "over": "100ms"}
    params = Params.of({"world": "world.yaml", "engine": engine, "script": [push]})
    plant = advance(SimulatedPlant(load_world(path), params, MS, 0), 600)
    mass = 80.0 + 2 * 1.0 + 2 * 0.1
    # Wheels of 0.001 kg·m² and 0.1 m that roll.
    mass += 2 * 0.001 / 0.1**2 if floor else 0.0
    assert velocity(plant, "base")[0] == pytest.approx(6.0 / mass, rel=off.get(engine, 1e-6))


@pytest.mark.parametrize("over", ["100us", "1700us", "100ms"])
def test_an_impulse_is_exact_whatever_the_duration(tmp_path, engine, over):
    seconds = {"100us": 1e-4, "1700us": 1.7e-3, "100ms": 0.1}[over]
    push = {"push": "club", "force": [0, 8, 0], "over": over}
    plant = pushed(tmp_path, engine, {"club": CLUB}, push, push, step_ns=5 * MS, steps=30)
    assert velocity(plant, "club")[1] == pytest.approx(2 * 8 * seconds / 2, **NEAR)
    assert not plant.script.pushes


def test_a_sleeping_body_wakes_up(tmp_path, engine):
    stone = link("stone", 1.0, box_inertia(1.0, (0.1,) * 3), '<box size="0.1 0.1 0.1"/>')
    bodies = {"ground": fixed(FLOOR), "stone": Row(robot(stone), "position: [0, 0, 0.05]")}
    push = {"at": "3s", "push": "stone", "force": [0, 0, 20]}
    plant = pushed(tmp_path, engine, bodies, push, world="sleeping: true", steps=3100)
    # PyBullet needs a substep to wake up a body.
    lost = 1e-3 if engine == "pybullet" else 0.0
    assert velocity(plant, "stone")[2] == pytest.approx((20 - 9.81) * (0.1 - lost), rel=1e-3)


def test_a_pushed_run_replays_and_branches_to_the_byte(tmp_path, engine):
    push = "{at: 100ms, push: link2, force: [20, 0, 0], over: 200ms, frame: link, point: [0, 0, 1]}"
    (tmp_path / "scenario.yaml").write_text(
        f"extends: two_link\nduration: 500ms\ncheckpoint: 50ms\nparticipants:\n"
        f"  plant: {{params: {{engine: {engine}, script: [{push}]}}}}\n"
    )
    options = Options(out=tmp_path / "run", host=InProcess())
    ran = run(load(tmp_path / "scenario.yaml", []), options)
    assert Preparation(ran.recording, tmp_path / "again").run().result.sha256 == ran.sha256
    call = "plant push link2 '[0, 9, 0]' 1s '{torque: [0, 3, 0]}'"
    for name, at, calls in (("same", "200ms", ()), ("other", "150ms", [call])):
        found = branch(ran.recording, tmp_path / name, at=at, calls=calls, in_process=True)
        assert (found.result.sha256 == ran.sha256) == (not calls)
    # From a checkpoint within the push that a call began.
    last = branch(found.result.recording, tmp_path / "last", at="250ms", in_process=True)
    assert last.result.sha256 == found.result.sha256


WRENCHES = {"rod": {}, "gust": {"link": "rod", "frame": "link", "point": [1, 0, 0]}}


def stand(folder, engine, inputs=WRENCHES, **pushes):
    make(folder, engine, {"rod": fixed(ROD)}, DRIFT).close()
    params = {"world": "world.yaml", "engine": engine, "pushes": pushes}
    ports, outputs = dict.fromkeys(inputs, "Wrench/1"), {"state": "JointState/1"}
    config = make_config("plant", ports, outputs, folder, params=params, publishes="first")
    participant = Plant(config)
    participant.start(dict.fromkeys(inputs, Description()))
    return Stand(participant)


def test_a_wrench_pushes_until_the_next_one(tmp_path, engine):
    here = stand(tmp_path, engine, gust=WRENCHES["gust"])
    step_s = here.participant.config.step_ns * 1e-9
    for step in range(20):
        wrenches = {
            0: {"gust": Wrench(force=(0, 0, -2), torque=(0, 0, 0))},
            4: {"rod": Wrench(force=(0, 0, 0), torque=(0, 1, 0))},
            10: {name: Wrench(force=(0, 0, 0), torque=(0, 0, 0)) for name in WRENCHES},
        }.get(step, {})
        here.update(step, **wrenches)
    plant = here.participant.plant
    expected = (10 * 2.0 + 6 * 1.0) * step_s / ROD_MOMENT
    assert state(plant, "hinge")[1] == pytest.approx(expected, **NEAR)
    with pytest.raises(CommandError, match="'rod': torque on rod is 0, nan, 0, not three finite"):
        here.update(20, rod=Wrench(force=(0, 0, 0), torque=(0, math.nan, 0)))


def test_mistakes_are_listed_before_the_run(tmp_path, engine):
    with pytest.raises(WiringError) as caught:
        stand(tmp_path, engine, {"rood": {}}, gost={"link": "rod"})
    first, second = str(caught.value).splitlines()
    assert first.endswith("inputs.rood: link 'rood' is unknown; did you mean 'rod'?")
    assert second.endswith("params.pushes.gost: is no input of type Wrench/1; known: rood")
    mistakes = {
        "push: link 'rodd' is unknown; did you mean 'rod'?": {"push": "rodd", "force": [0, 0, 1]},
        "'root' is fixed to the world": {"push": "root", "force": [0, 0, 1]},
        "a push needs 'over', and 'force' or 'torque'": {"push": "rod"},
        "must be a number, not nan": {"push": "rod", "force": [0, math.nan, 0]},
        "torque: belongs to 'push'": {"jam": "hinge", "torque": [0, 0, 1], "over": None},
    }
    for text, push in mistakes.items():
        with pytest.raises(WiringError, match=text):
            pushed(tmp_path, engine, {"rod": fixed(ROD)}, push)
    plant = make(
        tmp_path, engine, {"rod": fixed(ROD, "joint_defaults: {mode: velocity}")}, dynamics="off"
    )
    for arguments, text in (
        (("rodd", [0, 0, 1]), "did you mean 'rod'"),
        (("rod", [0, math.inf, 1]), "force"),
        (("rod", [0, 0, 1], "now"), "over"),
        (("rod", [0, 0, 1], "1s", "link"), "MORE must be a map"),
        (("rod", [0, 0, 1]), "nothing can be pushed with `dynamics: off`"),
    ):
        with pytest.raises(CallError, match=text):
            plant.calls.push(*arguments)
