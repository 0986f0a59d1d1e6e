"""References that excite a robot: exact derivatives, jumps where they belong, the same noise."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from support.services.control import make_mission, mission_config

from stepbus_participant import SettingsError
from stepbus_schemas import JointReference

H = 1e-4
JOINTS = ("a", "b")


def generator(task: str, **params: object) -> Any:
    """Return the generator of a mission with such a task."""
    task = f"stepbus_mission.excitation:{task}"
    config = mission_config(task=task, joints=list(JOINTS), **params)
    return make_mission(config).participant.generator


def derivatives(made: Any, t: float) -> tuple[JointReference, list[float], list[float]]:
    """Return a reference, and slope and curvature by central differences."""
    before, now, after = (made.at(t + dt) for dt in (-H, 0.0, H))
    slope = [(y - x) / (2 * H) for x, y in zip(before.position, after.position, strict=True)]
    curve = [(y - x) / (2 * H) for x, y in zip(before.velocity, after.velocity, strict=True)]
    return now, slope, curve


@pytest.mark.parametrize("t", [0.3, 1.9, 3.5])
@pytest.mark.parametrize("ends", [1.0, 12.0])
def test_the_derivatives_of_a_chirp_are_exact(t: float, ends: float) -> None:
    made = generator("Chirp", amplitude=[0.2, 0.5], offset=0.1, omega=4, omega_end=ends, sweep=2)
    now, slope, curve = derivatives(made, t)
    assert now.velocity == pytest.approx(slope, abs=1e-5)
    assert now.acceleration == pytest.approx(curve, abs=1e-4)


def test_a_chirp_goes_on_where_its_sweep_ends() -> None:
    made = generator("Chirp", omega=1, omega_end=9, sweep=2)
    before, after = made.at(2.0 - 1e-9), made.at(2.0 + 1e-9)
    assert before.position == pytest.approx(after.position, abs=1e-6)
    assert before.velocity == pytest.approx(after.velocity, abs=1e-6)
    # The angle is 10 rad at the end of the sweep, and grows by 9 rad/s from there on.
    assert made.at(3.0).position[0] == pytest.approx(math.sin(19.0))


def test_a_ramp_has_one_velocity_and_then_rests() -> None:
    made = generator("Ramp", initial=[1, 0], target=[2, -1], time=0.5, rise=2)
    assert made.at(0.4) == made.at(0.0)
    middle = made.at(1.5)
    assert (middle.position, middle.velocity) == ([1.5, -0.5], [0.5, -0.5])
    assert (made.at(2.5).position, made.at(9.0).velocity) == ([2, -1], [0, 0])
    assert made.duration == 2.5


def test_an_impulse_is_there_and_gone() -> None:
    made = generator("Impulse", initial=0.5, height=[0.1, -0.2], time=1, width=0.005)
    steps = [made.at(0.005 * n).position for n in range(300)]
    assert [n for n, q in enumerate(steps) if q != [0.5, 0.5]] == [200]
    assert steps[200] == pytest.approx([0.6, 0.3])
    assert made.duration == 1.005


def test_noise_is_a_sequence_of_the_greatest_length() -> None:
    made = generator("Noise", amplitude=[1, 2], hold=0.1)
    length = 2**15 - 1
    bits = [made.at(0.1 * n).position[0] for n in range(length)]
    assert sum(bits) == 1.0
    # As of no other sequence, all runs of 15 bits but one are in it, each once.
    runs = {tuple(bits[n : n + 15]) for n in range(length - 15)}
    assert len(runs) == length - 15
    assert bits[:40] == [made.at(0.1 * (n + length)).position[0] for n in range(40)]


def test_noise_holds_each_bit_and_differs_between_joints_and_seeds() -> None:
    def rows(**params: object) -> list[list[float]]:
        made = generator("Noise", hold=0.1, **params)
        return [made.at(0.005 * n).position for n in range(2000)]

    one, other = rows(seed=1), rows(seed=2)
    changes = [n for n, (a, b) in enumerate(pairwise(one), 1) if a != b]
    assert all(n % 20 == 0 for n in changes)
    assert [a for a, _ in one] != [b for _, b in one]
    assert one != other


def first_bits(count: int, **params: object) -> np.ndarray:
    """Return the first bits of each joint, shape (count, 2)."""
    made = generator("Noise", amplitude=1, hold=0.1, **params)
    return np.array([made.at(0.1 * n).position for n in range(count)])


@pytest.mark.parametrize("seed", range(8))
def test_noise_is_even_from_its_first_second_on(seed: int) -> None:
    bits = first_bits(1024, seed=seed)
    # Of fair bits the mean has a deviation of 1/√n; a run is rarely longer than log2 n + 5.
    assert np.abs(bits[:100].mean(axis=0)).max() < 3 / math.sqrt(100)
    assert np.abs(bits[:300].mean(axis=0)).max() < 4 / math.sqrt(300)
    for row in bits.T:
        ends = np.flatnonzero(np.diff(row, prepend=0.0, append=0.0))
        assert np.diff(ends).max() <= 15
    # White: each eighth of the spectrum has an eighth of the power, to 4 deviations of 64 bins.
    power = np.abs(np.fft.rfft(bits, axis=0)[1:]) ** 2 / len(bits)
    bands = power.reshape(8, 64, 2).mean(axis=1)
    assert np.abs(bands - 1.0).max() < 4 / math.sqrt(64)


@pytest.mark.parametrize(
    ("task", "params", "text"),
    [
        ("Chirp", {"sweep": 0}, "sweep: must be a number above 0"),
        ("Ramp", {}, "target"),
        ("Noise", {"hold": 1e-12}, "it must be longer than"),
        ("Chirp", {"end_when_done": True}, "this task never ends"),
    ],
)
def test_wrong_parameters_are_named(task: str, params: dict[str, object], text: str) -> None:
    with pytest.raises(SettingsError, match=text):
        generator(task, **params)
