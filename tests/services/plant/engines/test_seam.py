"""The seam: who knows which engine, which one is taken, and what both compute alike."""

import importlib.util
import math

import numpy as np
import pytest
from support.services.mechanics import DISC, fixed, make

import stepbus
from stepbus import Recording
from stepbus_plant import engines
from stepbus_plant.engines import ENGINES, default_engine, is_here
from stepbus_plant.geometry import (
    Geometry,
    quaternion,
    rotation,
)
from stepbus_schemas import WiringError


def hide(monkeypatch, name):
    """Let a package be not installed."""
    real = importlib.util.find_spec
    monkeypatch.setattr(engines, "find_spec", lambda n: None if n == name else real(n))


@pytest.mark.parametrize("name", ENGINES)
def test_an_engine_that_is_not_installed_is_refused_by_one_sentence(tmp_path, monkeypatch, name):
    hide(monkeypatch, name)
    other = next(n for n in ENGINES if n != name)
    instead = f", or use engine {other}" if is_here(other) else ""
    sentence = f"engine {name} is not installed; run `pip install {name}`{instead}"
    with pytest.raises(WiringError) as caught:
        make(tmp_path, None, {"disc": fixed(DISC)}, f"engine: {name}")
    assert str(caught.value) == sentence


def test_the_default_is_the_first_engine_that_is_installed(monkeypatch):
    assert default_engine() == next(name for name in ENGINES if is_here(name))
    hide(monkeypatch, ENGINES[0])
    if is_here(ENGINES[1]):
        assert default_engine() == ENGINES[1]


def test_an_engine_that_nobody_knows_is_refused_with_its_line(tmp_path):
    with pytest.raises(WiringError, match=r"world\.yaml:1: .*engine.*'bullet'"):
        make(tmp_path, None, {"disc": fixed(DISC)}, "engine: bullet")


def test_the_engine_of_the_world_is_taken(tmp_path, engine):
    plant = make(tmp_path, None, {"disc": fixed(DISC)}, f"engine: {engine}")
    assert plant.physics.engine.name == engine


def test_the_engine_of_the_params_goes_over_the_worlds(tmp_path, engine):
    other = next(name for name in ENGINES if name != engine)
    plant = make(tmp_path, engine, {"disc": fixed(DISC)}, f"engine: {other}")
    assert plant.physics.engine.name == engine


def test_a_recording_says_which_engine_it_was(tmp_path, engine):
    result = stepbus.run(
        "two_link",
        set={"plant.params.engine": engine, "duration": "50ms"},
        out=tmp_path / "run",
        in_process=True,
    )
    versions = Recording(result.recording).metadata["versions/plant"]
    assert [name for name in ENGINES if name in versions] == [engine]


# --- geometry -----------------------------------------------------------------------------

COUNT = 10_000


@pytest.fixture(scope="module")
def bullet():
    if not is_here("pybullet"):
        pytest.skip("pybullet is not installed")
    return pytest.importorskip("stepbus_plant.engines.pybullet")


def angles():
    """Return roll, pitch, yaw, shape (COUNT, 3) [rad]; some of them are round."""
    rng = np.random.default_rng(20261126)
    drawn = rng.uniform(-2 * math.pi, 2 * math.pi, (COUNT, 3))
    drawn[::10] = np.round(drawn[::10] / (math.pi / 4)) * (math.pi / 4)
    return drawn.tolist()


def test_quaternions_are_pybullets_to_the_bit(bullet):
    ours = [quaternion(rpy) for rpy in angles()]
    assert ours == [bullet.bullet.getQuaternionFromEuler(rpy) for rpy in angles()]


def test_rotations_are_pybullets_to_the_bit(bullet):
    turns = [quaternion(rpy) for rpy in angles()]
    ours = [tuple(rotation(turn).ravel().tolist()) for turn in turns]
    assert ours == [bullet.bullet.getMatrixFromQuaternion(turn) for turn in turns]


def poses():
    """Return pairs of poses, within 2 m and 2 turns of each other."""
    places = np.random.default_rng(4).uniform(-1, 1, (COUNT, 3)).tolist()
    rows = [(tuple(p), quaternion(rpy)) for p, rpy in zip(places, angles(), strict=True)]
    return list(zip(rows[::2], rows[1::2], strict=True))


def gap(one, other):
    """Return how far two poses are apart, whatever the sign of their quaternions."""
    sign = math.copysign(1.0, np.dot(one[1], other[1]))
    return max(
        np.abs(np.subtract(one[0], other[0])).max(),
        np.abs(np.subtract(one[1], np.multiply(sign, other[1]))).max(),
    )


def test_poses_of_the_two_geometries_agree(bullet):
    ours, theirs = Geometry(), bullet.BulletGeometry()
    worst = 0.0
    for one, other in poses():
        worst = max(worst, gap(ours.compose(one, other), theirs.compose(one, other)))
        worst = max(worst, gap(ours.inverse(one), theirs.inverse(one)))
        direction = np.subtract(ours.turned(one[1], other[0]), theirs.turned(one[1], other[0]))
        worst = max(worst, np.abs(direction).max())
        point = np.subtract(ours.into(one, other[0]), theirs.into(one, other[0]))
        worst = max(worst, np.abs(point).max())
    assert worst < 1e-6
