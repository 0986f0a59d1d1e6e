"""The round trip of an arm, without a plant."""

from pathlib import Path

from stepbus.testing import Bench
from stepbus_participant import Config
from stepbus_scenarios import __file__ as SCENARIOS  # noqa: N812
from stepbus_schemas import Description, GoalStatus, InputConfig, OutputConfig, Poses
from stepbus_store.round_trip import RoundTrip

LINKS = ["base", "link2"]
FAR = Poses(position=[(0.0, 0.0, 0.0), (9.0, 0.0, 0.0)], orientation=[(0.0, 0.0, 0.0, 1.0)] * 2)


def round_trip(**params):
    config = Config(
        name="mission",
        step_ns=8_000_000,
        every=1,
        seed=0,
        folder=Path(SCENARIOS).parent / "two_link",
        inputs={
            "poses": InputConfig(source="plant", port="poses", type="Poses/1"),
            "status": InputConfig(source="arm", port="status", type="GoalStatus/1"),
        },
        outputs={"goal": OutputConfig(type="Goal/1"), "events": OutputConfig(type="Event/1")},
        params={"model": "two_link.urdf", "frame": "base", "arms": {"arm": "link2"}, **params},
    )
    return Bench(RoundTrip, config, {"poses": Description(names=LINKS), "status": Description()})


def test_a_warning_about_the_way_home_is_not_that_of_a_pose():
    bench = round_trip(poses=1, home={"arm": {"joint1": 0.0}})
    goal = bench.step(0, poses=FAR)["goal"]
    missed = bench.step(1, poses=FAR, status=GoalStatus(id=goal.id, state="succeeded"))
    assert missed["events"].text.startswith("arm 1/1: ")
    home = missed["goal"]
    assert (home.type, home.joints) == ("move_joints", ["joint1"])
    warned = GoalStatus(id=home.id, state="accepted", cause="not_holdable", text="weak")
    assert bench.step(2, status=warned) == {}
    end = bench.step(3, status=GoalStatus(id=home.id, state="succeeded"))
    assert "1 missed without being named" in end["events"].text
