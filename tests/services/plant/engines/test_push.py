"""Pushes beside the closed form on each engine: impulse is the change of momentum."""

import math

import numpy as np
import pytest
import support.services.mechanics as m
from support.services.control import Stand, make_config
from support.services.devices import write_base

import stepbus
from stepbus.errors import CallError
from stepbus_plant import Plant
from stepbus_plant.commander import CommandError
from stepbus_plant.engine import BASE
from stepbus_plant.geometry import quaternion, rotation
from stepbus_schemas import Description, WiringError, Wrench

RPY = (0.3, -0.7, 1.1)
TURN = rotation(quaternion(RPY))
INERTIA = (0.04, 0.05, 0.07)
HEAD = m.robot(m.link("head", 2.0, INERTIA, centre="0.3 0 0.1"))
CLUB = {"club": m.Row(HEAD, f"position: [5, 3, 2], orientation_rpy: {list(RPY)}")}
ROD = {"rod": m.fixed(m.ROD)}
NOTHING, UP = (0, 0, 0), [0, 0, 1]
NEAR = {"rel": 1e-6, "abs": 1e-7}


def pushed(folder, engine, bodies, *pushes, world="gravity: [0, 0, 0]", steps=200, step_ns=m.MS):
    """Return a plant after some steps; it pushes at 10 ms, for 100 ms."""
    script = [{"at": "10ms", "over": "100ms", **push} for push in pushes]
    return m.advance(m.make(folder, engine, bodies, world, step_ns, script=script), steps)


@pytest.mark.parametrize("frame", ["world", "link"])
def test_a_free_body_takes_up_angular_momentum(tmp_path, engine, frame):
    push = {"force": [30, -40, 50], "torque": [1, 2, -3], "point": [0.5, 0.2, 0], "frame": frame}
    # Within one substep, it does not turn yet: angular momentum is r x F t + T t.
    plant = pushed(tmp_path, engine, CLUB, {"push": "head", "over": "1ms", **push}, steps=11)
    turn = np.eye(3) if frame == "link" else TURN.T
    force, torque = turn @ push["force"], turn @ push["torque"]
    spin = plant.physics.engine.motion((0, BASE)).spin
    expected = (np.cross((0.2, 0.2, -0.1), force) + torque) * 1e-3 / INERTIA
    assert TURN.T @ spin == pytest.approx(expected, **NEAR)
    own = f"{' in its frame' if frame == 'link' else ''} at its point 0.5, 0.2, 0 m for 1ms"
    assert plant.script.events[0].endswith(f"pushed with 30, -40, 50 N and 1, 2, -3 N·m{own}")


@pytest.mark.parametrize(
    ("push", "torque"),
    [
        ({"force": [0, 0, -2], "frame": "link"}, 1.0),
        ({"force": [0, 0, -2], "frame": "link", "point": [1, 0, 0]}, 2.0),
        ({"torque": [5, 0.3, -7]}, 0.3),
    ],
)
def test_a_pendulum_takes_up_the_moment(tmp_path, engine, push, torque):
    plant = pushed(tmp_path, engine, ROD, {"push": "rod/rod", **push})
    assert m.state(plant, "hinge")[1] == pytest.approx(torque * 0.1 / m.ROD_MOMENT, **NEAR)


@pytest.mark.parametrize("friction", [0, 1])
def test_a_base_takes_up_the_impulse(tmp_path, engine, friction):
    write_base(tmp_path)
    files = [(tmp_path / f"{name}.urdf").read_text() for name in ("ground", "base")]
    slides = f"friction: {{lateral: {friction}}}"
    base = m.Row(files[1], "position: [0, 0, 0.1]" + ("" if friction else f", {slides}"))
    push = {"at": "500ms", "push": "base", "force": [60, 0, 0]}
    bodies = {"ground": m.fixed(files[0], slides), "base": base}
    plant = pushed(tmp_path, engine, bodies, push, world="", steps=600)
    # Two wheels of 0.001 kg·m² roll on 0.1 m, less half of what they sink in.
    radius = 0.1 + m.between(plant, "base", "ground")[0].distance / 2
    rolling = friction * 2 * 0.001 / radius**2
    assert m.velocity(plant, "base")[0] == pytest.approx(6.0 / (82.2 + rolling), rel=1e-6)


@pytest.mark.parametrize(("over", "ms"), [("100us", 0.1), ("1700us", 1.7), ("100ms", 100.0)])
def test_a_free_body_takes_up_the_impulse_whatever_the_duration(tmp_path, engine, over, ms):
    push = {"push": "club", "force": [3, 8, -5], "over": over}
    own = {**push, "frame": "link"}
    plant = pushed(tmp_path, engine, CLUB, push, own, step_ns=5 * m.MS, steps=30)
    impulse = (np.eye(3) + TURN) @ push["force"] * ms * 1e-3
    assert m.velocity(plant, "club") == pytest.approx(impulse / 2.0, **NEAR)
    assert not plant.script.pushes


def test_a_sleeping_body_wakes_up(tmp_path, engine):
    stone = m.Row(m.box("stone", 1.0, 0.1, 0.1, 0.1), "position: [0, 0, 0.05]")
    bodies = {"ground": m.fixed(m.FLOOR), "stone": stone}
    push = {"at": "3s", "push": "stone", "force": [0, 0, 20]}
    plant = pushed(tmp_path, engine, bodies, push, world="sleeping: true", steps=3100)
    # PyBullet needs a substep to wake up a body.
    seconds = 0.099 if engine == "pybullet" else 0.1
    assert m.velocity(plant, "stone")[2] == pytest.approx((20 - 9.81) * seconds, rel=1e-3)


def test_a_pushed_run_replays_and_branches_to_the_byte(tmp_path, engine):
    push = "{at: 100ms, push: link2, force: [20, 0, 0], over: 200ms, frame: link, point: [0, 0, 1]}"
    (tmp_path / "scenario.yaml").write_text(
        f"extends: two_link\nduration: 500ms\ncheckpoint: 50ms\nparticipants:\n"
        f"  plant: {{params: {{engine: {engine}, script: [{push}]}}}}\n"
    )
    ran = stepbus.run(tmp_path, out=tmp_path / "run", in_process=True)
    assert stepbus.rerun(ran.recording, tmp_path / "again").result.sha256 == ran.sha256
    call = "plant push link2 '[0, 9, 0]' 1s '{torque: [0, 3, 0]}'"
    for name, at, calls in (("same", "200ms", ()), ("other", "150ms", [call])):
        found = stepbus.branch(ran.recording, tmp_path / name, at=at, calls=calls, in_process=True)
        assert (found.result.sha256 == ran.sha256) == (not calls)
    # From a checkpoint within the push that a call began.
    last = stepbus.branch(found.result.recording, tmp_path / "last", at="250ms", in_process=True)
    assert last.result.sha256 == found.result.sha256


def stand(folder, engine, *ports, **pushes):
    """Return a started plant of a rod whose inputs push it."""
    m.make(folder, engine, ROD, "gravity: [0, 0, 0]").close()
    params = {"world": "world.yaml", "engine": engine, "pushes": pushes}
    inputs, outputs = dict.fromkeys(ports, "Wrench/1"), {"state": "JointState/1"}
    plant = Plant(make_config("plant", inputs, outputs, folder, params=params, publishes="first"))
    plant.start(dict.fromkeys(ports, Description()))
    return Stand(plant)


def test_a_wrench_pushes_until_the_next_one(tmp_path, engine):
    gust = {"link": "rod", "frame": "link", "point": [1, 0, 0]}
    here = stand(tmp_path, engine, "rod", "gust", gust=gust)
    wrenches = {
        0: {"gust": Wrench(force=(0, 0, -2), torque=NOTHING)},
        4: {"rod": Wrench(force=NOTHING, torque=(0, 1, 0))},
        10: dict.fromkeys(("rod", "gust"), Wrench(force=NOTHING, torque=NOTHING)),
    }
    for step in range(20):
        here.update(step, **wrenches.get(step, {}))
    momentum = (10 * 2.0 + 6 * 1.0) * here.participant.config.step_ns * 1e-9
    speed = m.state(here.participant.plant, "hinge")[1]
    assert speed == pytest.approx(momentum / m.ROD_MOMENT, **NEAR)
    with pytest.raises(CommandError, match="'rod': torque on rod is 0, nan, 0, not three finite"):
        here.update(20, rod=Wrench(force=NOTHING, torque=(0, math.nan, 0)))


def test_mistakes_are_told_before_anything_is_pushed(tmp_path, engine):
    with pytest.raises(WiringError) as caught:
        stand(tmp_path, engine, "rood", gost={"link": "rod"})
    first, second = str(caught.value).splitlines()
    assert first.endswith("inputs.rood: link 'rood' is unknown; did you mean 'rod'?")
    assert second.endswith("params.pushes.gost: is no input of type Wrench/1; known: rood")
    for text, push in {
        "push: link 'rodd' is unknown; did you mean 'rod'?": {"push": "rodd", "force": UP},
        "'root' is fixed to the world": {"push": "root", "force": UP},
        "a push needs 'over', and 'force' or 'torque'": {"push": "rod"},
        "must be a number, not nan": {"push": "rod", "force": [0, math.nan, 0]},
        "torque: belongs to 'push'": {"jam": "hinge", "torque": UP},
    }.items():
        with pytest.raises(WiringError, match=text):
            pushed(tmp_path, engine, ROD, push)
    driven = {"rod": m.fixed(m.ROD, "joint_defaults: {mode: velocity}")}
    plant = m.make(tmp_path, engine, driven, dynamics="off")
    for given, text in (
        (["1s"], "nothing can be pushed with `dynamics: off`"),
        (["now"], "over: 'now' is not a duration"),
        (["1s", "link"], "MORE must be a map"),
        (["1s", {"push": "root"}], "MORE must be a map of torque, frame and point"),
    ):
        with pytest.raises(CallError, match=text):
            plant.calls.push("rod", UP, *given)
