"""Pushes beside the closed form on each engine: impulse is the change of momentum."""

import math
from contextlib import closing

import numpy as np
import pytest
from support.services.control import Stand, make_config
from support.services.devices import write_base
from support.services.mechanics import (
    DISC,
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

from stepbus_participant import CallError
from stepbus_plant import Params, Plant, SimulatedPlant, load_world
from stepbus_plant.commander import CommandError
from stepbus_plant.engine import BASE
from stepbus_plant.geometry import rotation
from stepbus_schemas import Description, WiringError, Wrench

INERTIA = (0.02, 0.05, 0.09)
CLUB = Row(
    robot(link("head", 2.0, INERTIA, centre="0.3 0 0.1")),
    "position: [5, 3, 2], orientation_rpy: [0.3, -0.7, 1.1]",
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
        "at 0.01 s: club is pushed with 3, -4, 5 N" + " in its frame" * (frame == "link") + " for 100ms"
    ]


def test_a_point_and_a_torque_turn_a_free_body_about_its_centre(tmp_path, engine):
    # Within one substep, it does not turn yet: angular momentum is r x F t + T t.
    push = {"push": "head", "force": [30, -40, 50], "torque": [1, 2, -3], "point": [0.5, 0.2, 0]}
    start = make(tmp_path, engine, {"club": CLUB}, DRIFT)
    turn = rotation(start.physics.engine.frame((0, BASE))[1])
    plant = pushed(tmp_path, engine, {"club": CLUB}, {**push, "over": "1ms"}, steps=11)
    arm = turn @ (0.2, 0.2, -0.1)
    momentum = (np.cross(arm, push["force"]) + push["torque"]) * 1e-3
    expected = turn @ ((turn.T @ momentum) / INERTIA)
    assert spin(plant) == pytest.approx(expected, rel=1e-6, abs=1e-7)
    expected = turn @ ((turn.T @ ((np.cross(turn @ (0.2, 0.2, -0.1), turn @ push["force"])) + turn @ push["torque"]) * 1e-3) / INERTIA)
    plant = pushed(tmp_path, engine, {"club": CLUB}, {**push, "over": "1ms", "frame": "link"}, steps=11)
    assert spin(plant) == pytest.approx(expected, rel=1e-6, abs=1e-7)


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
