import numpy as np
import pytest
from support.services.plant import digest, make_plant, swing

from stepbus_plant import Params
from stepbus_schemas import WiringError


def positions(folder, steps=2000, seed=3, **params):
    plant = make_plant(folder, seed=seed, world="gravity: [0, 0, 0]", **read(params))
    return np.array([plant.sense().position for _ in range(steps)])


def read(params):
    checked = Params.of({"world": "world.yaml", **params})
    return {key: getattr(checked, key) for key in params}


def test_only_what_is_asked_for_is_sensed(tmp_path):
    state = make_plant(tmp_path, **read({"sense": ["position"]})).sense()
    assert state.position == [0.0, 0.0]
    assert (state.velocity, state.effort, state.target) == (None, None, None)


def test_noise_has_the_deviation_asked_for(tmp_path):
    noise = positions(tmp_path, noise={"position": 0.01})
    assert noise.std() == pytest.approx(0.01, rel=0.1)
    assert abs(noise.mean()) < 0.001


def test_noise_repeats_with_its_seed(tmp_path):
    first, second = (positions(tmp_path, 50, noise={"position": 0.01}) for _ in range(2))
    assert digest(first) == digest(second)


def test_noise_on_one_quantity_does_not_change_that_on_another(tmp_path):
    first = positions(tmp_path, 50, noise={"position": 0.01})
    second = positions(tmp_path, 50, noise={"position": 0.01, "velocity": 0.1, "effort": 1})
    assert digest(first) == digest(second)


def test_noise_does_not_reach_the_physics(tmp_path):
    quiet = swing(make_plant(tmp_path), 200)
    noisy = swing(make_plant(tmp_path, **read({"noise": {"position": 0.1}})), 200)
    assert digest(quiet[:, 1]) == digest(noisy[:, 1])


def test_readings_are_whole_multiples_of_the_resolution_and_nearest(tmp_path):
    true = swing(make_plant(tmp_path), 100)[:, 0]
    read_out = swing(make_plant(tmp_path, **read({"resolution": {"position": 0.01}})), 100)[:, 0]
    assert np.abs(read_out / 0.01 - np.round(read_out / 0.01)).max() < 1e-9
    assert np.abs(read_out - true).max() <= 0.005 + 1e-12


def test_chosen_joints_are_sensed_in_their_order(tmp_path):
    plant = make_plant(tmp_path, joints=["joint2", "joint1"])
    both = swing(make_plant(tmp_path), 50)
    turned = swing(plant, 50)
    assert plant.joints.description.names == ["joint2", "joint1"]
    assert digest(both) == digest(np.ascontiguousarray(turned[:, :, ::-1]))


def test_a_joint_that_is_not_sensed_is_commanded_all_the_same(tmp_path):
    plant = make_plant(tmp_path, joints=["joint2"])
    assert digest(swing(plant, 50)[:, 0, 0]) == digest(swing(make_plant(tmp_path), 50)[:, 0, 1])


def test_all_mistakes_of_the_parameters_are_listed():
    params = {
        "sense": ["position", "colour"],
        "noise": {"position": -1, "speed": 2},
        "resolution": {"position": 0},
        "actuation": "magic",
        "jonts": ["joint1"],
    }
    with pytest.raises(WiringError) as caught:
        Params.of(params)
    lines = str(caught.value).splitlines()
    assert [line.split(":")[0] for line in lines] == [
        "the key 'world' is missing",
        "sense[1]",
        "noise.position",
        "noise.speed",
        "resolution.position",
        "actuation",
        "jonts",
    ]


@pytest.mark.parametrize(
    ("params", "mistake"),
    [
        ({"joints": []}, "joints: must be a list of one or more names"),
        ({"joints": ["a", "b", "a"]}, "joints: names 'a' twice"),
        ({"physics_step": "8"}, "physics_step: '8' is not a duration"),
    ],
)
def test_contradicting_parameters_are_refused(params, mistake):
    with pytest.raises(WiringError, match=mistake):
        Params.of({"world": "world.yaml", **params})


def test_quantities_do_not_share_their_noise(tmp_path):
    plant = make_plant(tmp_path, **read({"noise": {"position": 1, "velocity": 1}}))
    state = plant.sense()
    assert state.position != state.velocity
