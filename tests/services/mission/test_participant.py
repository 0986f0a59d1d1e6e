"""The mission as a participant: its events, its end, its mistakes."""

import pytest
from support.services.control import SINE, make_mission, mission_config

from stepbus_mission.mission import Mission
from stepbus_schemas import Event, RunError, WiringError

MOVE = {
    "task": "waypoints",
    "joints": ["a", "b"],
    "waypoints": [{"position": [0, 0]}, {"duration": 0.01, "position": [1, 2]}],
}


def test_it_tells_when_it_begins_and_when_it_is_done() -> None:
    mission = make_mission(mission_config(**MOVE))
    events = [mission.update(index).get("event") for index in range(5)]
    begins = Event(level="info", text="waypoints of a, b starts")
    done = Event(level="info", text="waypoints is done at 0.010 s")
    assert events == [begins, None, done, None, None]


@pytest.mark.parametrize("end_when_done", [True, False])
def test_it_ends_the_run_only_where_asked_to(end_when_done: bool) -> None:
    mission = make_mission(mission_config(**MOVE, end_when_done=end_when_done))
    mission.update(1)
    assert mission.end_reason is None
    mission.update(2)
    wanted = "mission: waypoints is done at 0.010 s" if end_when_done else None
    assert mission.end_reason == wanted


def test_an_event_is_published_only_where_it_is_wired() -> None:
    config = mission_config(**MOVE)
    del config.outputs["event"]
    assert list(make_mission(config).update(0)) == ["reference"]


def test_every_mistake_in_the_params_is_listed() -> None:
    with pytest.raises(WiringError) as caught:
        Mission(
            mission_config(
                task="sine", joints=["a", "a"], amplitude=[1, 2], omga=3, phase="x", end_when_done=1
            )
        )
    keys = [row.split("params.")[1].split(":")[0] for row in str(caught.value).splitlines()]
    assert keys == ["joints", "end_when_done", "phase", "omga"]


WAYPOINTS = [
    {"duration": 1, "position": [0, 0]},
    {"position": [0, 0]},
    {"time": 1, "position": [0]},
    {"time": 0, "position": [0, 0]},
]


def test_every_mistake_in_the_waypoints_is_listed() -> None:
    with pytest.raises(WiringError) as caught:
        Mission(mission_config(**{**MOVE, "waypoints": WAYPOINTS}))
    keys = [row.split("waypoints")[1].split(":")[0] for row in str(caught.value).splitlines()]
    assert keys == ["[0]", "[1]", "[2].position", "[3].time"]


@pytest.mark.parametrize(
    ("params", "sentence"),
    [
        ({"joints": ["a"]}, "the key 'task' is missing"),
        (
            {**SINE, "task": "sinus"},
            "task: must be .* or file.py:Class, not 'sinus'; did you mean 'sine'",
        ),
        ({**SINE, "joints": []}, "joints: must be a list of one or more names"),
        ({**SINE, "end_when_done": True}, "end_when_done: is true, but this task never ends"),
        ({"task": "step", "joints": ["a"]}, "the key 'target' is missing"),
        ({"task": "csv", "joints": ["a"], "file": "none.csv"}, "file 'none.csv' not found"),
        (
            {**MOVE, "waypoints": [{"position": 0}]},
            "waypoints: has 1 waypoint; it needs at least two",
        ),
        ({**MOVE, "waypoints": [{"positon": 0}]}, r"\[0\]: the key 'position' is missing"),
        ({**MOVE, "waypoints": "all"}, "waypoints: must be a list, not 'all'"),
    ],
)
def test_each_mistake_has_its_sentence(params: dict, sentence: str) -> None:
    with pytest.raises(WiringError, match=sentence):
        Mission(mission_config(**params))


@pytest.mark.parametrize(
    ("body", "sentence"),
    [("[0.0], [0.0], [0.0]", r"\[1, 1, 1\]"), ("[0.0] * 2, [0.0] * 2, [1e400] * 2", "not finite")],
)
def test_a_users_generator_is_checked_at_every_step(tmp_path, body: str, sentence: str) -> None:
    name = f"bad_generator_{len(body)}"
    (tmp_path / f"{name}.py").write_text(
        "from stepbus_schemas import JointReference\n"
        "class Bad:\n"
        "    def __init__(self, joints, params): pass\n"
        "    def at(self, t):\n"
        f"        p, v, a = {body}\n"
        "        return JointReference(position=p, velocity=v, acceleration=a)\n"
    )
    mission = make_mission(mission_config(tmp_path, task=f"{name}:Bad", joints=["a", "b"]))
    with pytest.raises(RunError, match=sentence):
        mission.update(0)


def test_a_users_generator_that_cannot_be_made_is_named(tmp_path) -> None:
    (tmp_path / "broken_generator.py").write_text(
        "class Broken:\n"
        "    def __init__(self, joints, params): raise KeyError('rate')\n"
        "    def at(self, t): pass\n"
    )
    config = mission_config(tmp_path, task="broken_generator:Broken", joints=["a"], rate=1)
    with pytest.raises(WiringError, match="cannot create Broken: KeyError: 'rate'"):
        Mission(config)
