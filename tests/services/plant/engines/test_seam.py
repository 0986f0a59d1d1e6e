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
    product,
    projection_matrix,
    quaternion,
    rotation,
    view_matrix,
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


def test_orientations_on_the_way_are_pybullets(bullet):
    shares = np.random.default_rng(5).uniform(0, 1, COUNT // 2).tolist()
    for (one, other), share in zip(poses(), shares, strict=True):
        position, ours = Geometry().between(one, other, share)
        theirs = bullet.bullet.getQuaternionSlerp(one[1], other[1], share)
        assert gap((position, ours), (position, theirs)) < 1e-6


def test_spins_are_pybullets(bullet):
    """Of orientations that are less than half a turn apart: at half a turn, both ways are right."""
    rng = np.random.default_rng(6)
    for rpy in angles()[: COUNT // 2]:
        one = quaternion(rpy)
        other = product(quaternion(rng.uniform(-1, 1, 3).tolist()), one)
        turn = bullet.bullet.getDifferenceQuaternion(one, other)
        axis, angle = bullet.bullet.getAxisAngleFromQuaternion(turn)
        theirs = np.multiply(axis, math.remainder(angle, 2 * math.pi))
        assert np.abs(Geometry().spin_between(one, other, 1.0) - theirs).max() < 1e-6


def test_views_and_projections_are_pybullets(bullet):
    rng = np.random.default_rng(7)
    for _ in range(500):
        target, distance = rng.uniform(-2, 2, 3).tolist(), rng.uniform(0.5, 5)
        yaw, pitch = rng.uniform(-180, 180), rng.uniform(-89, 89)
        theirs = bullet.bullet.computeViewMatrixFromYawPitchRoll(target, distance, yaw, pitch, 0, 2)
        ours = view_matrix(target, distance, math.radians(yaw), math.radians(pitch))
        np.testing.assert_allclose(ours, np.reshape(theirs, (4, 4)).T, atol=1e-5)
        fov, aspect, far = rng.uniform(5, 120), rng.uniform(0.5, 2), rng.uniform(2, 200)
        theirs = bullet.bullet.computeProjectionMatrixFOV(fov, aspect, 0.05, far)
        ours = projection_matrix(math.radians(fov), aspect, 0.05, far)
        np.testing.assert_allclose(ours, np.reshape(theirs, (4, 4)).T, rtol=1e-5, atol=1e-6)
