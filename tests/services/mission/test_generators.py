"""Reference generators: what they pass through, and that their derivatives are exact."""

import numpy as np
import pytest
from support.services.control import make_mission, mission_config

from stepbus_schemas import JointReference

H = 1e-4


def at(t: float, **params: object) -> JointReference:
    mission = make_mission(mission_config(joints=["a", "b"], **params))
    return mission.participant.generator.at(t)


WAYPOINTS = [
    {"position": [0, 1]},
    {"time": 2, "position": {"b": 0, "a": 1}},
    {"duration": 1, "position": [1, -1]},
]
TASKS = {
    "sine": {"amplitude": [1, 2], "omega": 3, "phase": {"a": 0, "b": 1}, "offset": 0.5},
    "waypoints": {"waypoints": WAYPOINTS},
}


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("t", [0.3, 1.1, 2.6])
def test_velocity_and_acceleration_are_exact(task: str, t: float) -> None:
    # Of central differences the error is about H².
    before, now, after = (at(t + dt, task=task, **TASKS[task]) for dt in (-H, 0.0, H))
    slope = np.subtract(after.position, before.position) / (2 * H)
    curvature = np.subtract(after.velocity, before.velocity) / (2 * H)
    assert now.velocity == pytest.approx(slope, abs=1e-6)
    assert now.acceleration == pytest.approx(curvature, abs=1e-6)


def test_a_step_change_happens_at_its_time() -> None:
    change = {"task": "step", "target": [1, 2], "initial": 0.5, "time": 1.0}
    assert [at(t, **change).position for t in (0.995, 1.0)] == [[0.5, 0.5], [1.0, 2.0]]


@pytest.mark.parametrize(("t", "position"), [(0, [0, 1]), (2, [1, 0]), (3, [1, -1]), (9, [1, -1])])
def test_waypoints_are_reached_at_their_times_and_at_rest(t: float, position: list) -> None:
    reference = at(t, task="waypoints", waypoints=WAYPOINTS)
    assert reference.position == pytest.approx(position, abs=1e-12)
    assert reference.velocity == pytest.approx([0, 0], abs=1e-12)
    assert reference.acceleration == pytest.approx([0, 0], abs=1e-12)


def test_between_waypoints_the_jerk_is_minimal() -> None:
    s = 0.5 / 2
    wanted = 10 * s**3 - 15 * s**4 + 6 * s**5
    assert at(0.5, task="waypoints", waypoints=WAYPOINTS).position[0] == pytest.approx(wanted)


def test_a_users_generator_is_loaded_from_the_scenarios_folder(tmp_path) -> None:
    (tmp_path / "my_generator.py").write_text(
        "from stepbus import JointReference, Settings\nfrom stepbus.params import PerJoint\n"
        "class Ramp:\n"
        "    class Params(Settings):\n"
        "        rate: PerJoint\n"
        "    def __init__(self, joints, params):\n"
        "        self.rate = params.rate.of(joints)\n"
        "    def at(self, t):\n"
        "        p = [r * t for r in self.rate]\n"
        "        a = [0.0] * len(p)\n"
        "        return JointReference(position=p, velocity=self.rate, acceleration=a)\n"
    )
    config = mission_config(tmp_path, task="my_generator:Ramp", joints=["a", "b"], rate=[1, 2])
    assert make_mission(config).update(200)["reference"].position == [1.0, 2.0]
