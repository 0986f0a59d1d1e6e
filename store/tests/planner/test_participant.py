"""The planner among steps: when it answers, what it wants of a scenario, and that it repeats."""

import hashlib
import math
import subprocess
import sys
from concurrent.futures import Future
from pathlib import Path

import msgspec
import pytest
from support.paths import TESTS
from support.services.control import Stand
from support.services.planner import (
    GOAL,
    JOINTS,
    PILLAR,
    START,
    answer,
    config,
    make_planner,
    scenery,
    write_arm,
)
from support.store_paths import STORE_TESTS

from stepbus_schemas import Description, PlanRequest, Poses, RunError, WiringError
from stepbus_store.planner.obstacles import PlannedRobot
from stepbus_store.planner.planner import Planner

ANYWHERE = PlanRequest(id=1, start=START, goal=GOAL)


@pytest.fixture
def planner(tmp_path):
    described, poses = scenery(PILLAR)
    made = []

    def make(**params):
        made.append(make_planner(tmp_path, described, **params))
        return Stand(made[-1]), poses

    yield make
    for participant in made:
        participant.close()


def steps_with_plans(stand, poses, requests, steps, every=1):
    """Return at which steps a plan came, and its id."""
    found = []
    for k in range(0, steps, every):
        new = {"request": requests[k]} if k in requests else {}
        messages = stand.update(k, poses=poses, **new)
        found += [(k, messages["plan"].id)] if "plan" in messages else []
    return found


NEWER = PlanRequest(id=2, start=START, goal=[0.5, 0.5, 0.5])
CHECK = PlanRequest(id=1, start=START, goal=START, path=[[-0.9, 0.0, 0.0], [-0.8, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("requests", "answers"),
    [
        ({4: ANYWHERE}, [(29, 1)]),
        ({0: ANYWHERE, 5: ANYWHERE}, [(25, 1)]),
        ({0: ANYWHERE, 10: NEWER}, [(35, 2)]),
        ({4: CHECK}, [(8, 1)]),
    ],
    ids=["latency", "the same again", "a newer one cancels it", "a check is sooner"],
)
def test_a_request_is_answered_once_after_its_latency(planner, requests, answers):
    stand, poses = planner()
    assert steps_with_plans(stand, poses, requests, 60) == answers


def test_the_latency_is_rounded_up_to_the_planners_own_period(planner):
    stand, poses = planner(every=6, latency="100ms")
    assert steps_with_plans(stand, poses, {12: ANYWHERE}, 60, every=6) == [(30, 1)]


def test_poses_that_are_none_are_refused_in_one_sentence(planner):
    stand, poses = planner()
    rows = (
        ({"position": []}, "expected 2 poses, received 0 positions and 2 orientations"),
        (
            {"position": [(0.0, 0.0, math.nan)] * 2},
            r"chassis has an invalid pose: position \(0.0, 0.0, nan\)",
        ),
        ({"orientation": [(0.0, 0.0, 0.0, 0.0)] * 2}, "chassis has an invalid pose"),
    )
    for k, (change, sentence) in enumerate(rows):
        with pytest.raises(RunError, match=f"^input 'poses': .*{sentence}"):
            stand.update(k, request=ANYWHERE, poses=msgspec.structs.replace(poses, **change))


def test_a_request_before_any_poses_is_refused(planner):
    stand, _ = planner()
    stand.update(0, request=ANYWHERE)
    assert "not known yet" in stand.update(25)["plan"].text


def test_every_answer_is_told(planner):
    stand, poses = planner()
    stand.update(0, request=ANYWHERE, poses=poses)
    told = stand.update(25)
    assert told["event"].level == "info"
    assert told["event"].text == f"plan 1: {told['plan'].text}"


def test_without_a_port_for_events_it_only_plans(planner):
    stand, poses = planner(event=False)
    stand.update(0, request=ANYWHERE, poses=poses)
    assert list(stand.update(25)) == ["plan"]


def test_a_world_seen_from_elsewhere_makes_no_difference(tmp_path):
    described, poses = scenery(PILLAR, shift=(2.0, -1.0, 0.25))
    planner = make_planner(tmp_path, described)
    stand = Stand(planner)
    stand.update(0, request=ANYWHERE, poses=poses)
    moved = stand.update(25)["plan"]
    planner.close()
    plan, _ = answer(tmp_path, PILLAR)
    assert moved.text == plan.text
    assert moved.position[50] == pytest.approx(plan.position[50], abs=1e-6)


def test_a_turned_robot_sees_the_world_turned(tmp_path):
    described, _ = scenery(PILLAR)
    quarter = (0.0, 0.0, 0.5**0.5, 0.5**0.5)
    poses = Poses(position=[(0.0, 0.0, 0.0), (0.0, 0.6, 0.5)], orientation=[quarter, quarter])
    planner = make_planner(tmp_path, described)
    stand = Stand(planner)
    stand.update(0, request=PlanRequest(id=1, start=START, goal=[0.0, 0.0, 0.0]), poses=poses)
    text = stand.update(25)["plan"].text
    planner.close()
    assert "link_1 touches pillar (70.0 mm deep)" in text


class EagerExecutor:
    """Plans within the step of the request, as if the search took no time."""

    def __init__(self, **_: object) -> None:
        """Take what the pool of threads takes."""

    def submit(self, work, *args, **named):
        done = Future()
        done.set_result(work(*args, **named))
        return done

    def shutdown(self, **_: object) -> None:
        """Do nothing: there are no threads."""


def digest_of_a_run(folder: Path) -> str:
    """Return the hash of all that is published."""
    described, poses = scenery(PILLAR)
    planner = make_planner(folder, described)
    stand, published = Stand(planner), hashlib.sha256()
    goals = {0: GOAL, 7: [1.0, 0.5, 0.5], 40: [0.9, -0.5, 0.3], 80: GOAL, 130: [0.0, 0.0, 0.0]}
    for k in range(200):
        goal = goals.get(k)
        new = {} if goal is None else {"request": PlanRequest(id=k, start=START, goal=goal)}
        for name, message in sorted(stand.update(k, poses=poses, **new).items()):
            published.update(f"{k} {name}".encode() + msgspec.msgpack.encode(message))
    planner.close()
    return published.hexdigest()


def test_a_search_that_takes_no_time_gives_the_same_bytes_as_one_in_another_process(
    tmp_path, monkeypatch
):
    code = (
        "import sys; sys.path[:0] = sys.argv[2:]\n"
        "from pathlib import Path; from test_participant import digest_of_a_run\n"
        "print(digest_of_a_run(Path(sys.argv[1])))"
    )
    write_arm(tmp_path)
    here = Path(__file__).parent
    command = [sys.executable, "-c", code, tmp_path, here, TESTS, STORE_TESTS]
    other = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    monkeypatch.setattr("stepbus_store.planner.planner.ThreadPoolExecutor", EagerExecutor)
    assert other.stdout.split() == [digest_of_a_run(tmp_path)]


def test_all_mistakes_of_a_scenario_are_listed_at_once(tmp_path):
    write_arm(tmp_path)
    with pytest.raises(WiringError) as caught:
        Planner(config(tmp_path, latency="fast", margin=-1, max_check=5))
    text = str(caught.value)
    for part in (
        "'fast' is not a duration", "margin: must be a number of at least 0, not -1",
        "max_check: unknown key 'max_check'; did you mean 'max_checks'?",
    ):  # fmt: skip
        assert part in text


def test_all_that_the_model_lacks_is_listed_at_once(tmp_path):
    write_arm(tmp_path)
    with pytest.raises(WiringError) as caught:
        Planner(config(tmp_path, joints=["one", "wheel_joint", "tow"], tip="hnad"))
    text = str(caught.value)
    for part in (
        "joint 'tow' is not in", "did you mean 'two'?", "link 'hnad' is not",
        "wheel_joint' of", "has no position limits",
    ):  # fmt: skip
        assert part in text


@pytest.mark.parametrize(
    ("params", "text"),
    [
        ({"posture": {"wheel_joint": 0.1}}, "has no position limits"),
        ({"posture": {"one": 0.1}}, "joint 'one' is also in 'joints'"),
        ({"posture": [1]}, "posture: must be a map, not a list"),
        ({"srdf": "arm.srdf"}, "file 'arm.srdf' not found"),
    ],
)
def test_a_mistaken_parameter_is_named(tmp_path, params, text):
    write_arm(tmp_path)
    with pytest.raises(WiringError) as caught:
        Planner(config(tmp_path, **params))
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"details": {}}, "input 'poses' does not describe the shape of its links"),
        ({"names": ["base", "pillar"]}, "input 'poses' has no link 'chassis'"),
        ({"details": {"shape": ["", "box 1 2"], "body": ["robot", "x"]}}, "'box 1 2'"),
    ],
)
def test_a_world_that_is_not_described_well_is_refused_at_the_start(tmp_path, change, text):
    described, _ = scenery(PILLAR)
    planner = make_planner(tmp_path, described)
    with pytest.raises(WiringError) as caught:
        planner.start(
            {"request": Description(), "poses": msgspec.structs.replace(described, **change)}
        )
    planner.close()
    assert str(caught.value).startswith("input 'poses'")
    assert text in str(caught.value)


def test_requests_in_another_order_of_joints_are_refused_at_the_start(tmp_path):
    described, _ = scenery()
    planner = make_planner(tmp_path, described)
    with pytest.raises(WiringError, match="has joints three, two, one, params"):
        planner.start({"request": Description(names=JOINTS[::-1]), "poses": described})
    planner.close()


def test_things_of_unknown_shape_are_told_once(tmp_path):
    described, poses = scenery(("statue", "mesh", (0.6, 0.0, 0.5)))
    planner = make_planner(tmp_path, described)
    stand = Stand(planner)
    first, second = stand.update(0, poses=poses), stand.update(1, poses=poses)
    planner.close()
    assert first["event"].text.startswith("the shape of statue is unknown")
    assert (first["event"].level, second) == ("warning", {})


def test_with_an_srdf_its_pairs_are_left_out(tmp_path):
    path, srdf = write_arm(tmp_path), tmp_path / "arm.srdf"
    srdf.write_text('<robot name="arm"><disable_collisions link1="link_0" link2="link_2"/></robot>')
    without, named = PlannedRobot(path, JOINTS), PlannedRobot(path, JOINTS, srdf=srdf)
    assert len(without.geometry.collisionPairs) == 4
    assert len(named.geometry.collisionPairs) == 5


def test_links_that_do_not_move_against_one_another_are_no_pair(tmp_path):
    geometry = PlannedRobot(write_arm(tmp_path), JOINTS[1:]).geometry
    joints = [item.parentJoint for item in geometry.geometryObjects]
    assert [joints[p.first] == joints[p.second] for p in geometry.collisionPairs] == [False] * 3


def after_the_pillar_moves(planner, to, request=ANYWHERE, moves_at=40):
    """Return the causes and texts of all plans, when the pillar moves on the way."""
    stand, _ = planner()
    far, near = (scenery((*PILLAR[:2], at))[1] for at in ((0.0, 3.0, 0.5), to))
    plans = []
    for k in range(120):
        new = {"request": request} if k == 4 else {}
        messages = stand.update(k, poses=far if k < moves_at else near, **new)
        plans += [(k, messages["plan"])] if "plan" in messages else []
    return [(k, plan.id, plan.cause) for k, plan in plans], plans[-1][1].text


def test_what_moves_into_a_way_that_was_found_is_told_at_once(planner):
    plans, text = after_the_pillar_moves(planner, (0.6, 0.0, 0.5))
    assert plans == [(29, 1, ""), (40, 1, "blocked")]
    assert text.startswith("pillar blocks the path 0.")
    assert text.endswith(" m ahead of tip")


def test_a_route_of_the_base_does_not_end_the_monitoring_of_an_arm_s_path(planner):
    stand, _ = planner()
    far, near = (scenery((*PILLAR[:2], at))[1] for at in ((0.0, 3.0, 0.5), (0.6, 0.0, 0.5)))
    drive = PlanRequest(id=2, start=[], goal=[], base=((0.0, 0.0, 0.0), (0.0, -2.0, 0.0)))
    found = []
    for k in range(80):
        new = {4: ANYWHERE, 32: drive}.get(k)
        out = stand.update(k, poses=far if k < 60 else near, **({"request": new} if new else {}))
        found += [(out["plan"].id, out["plan"].cause)] if "plan" in out else []
    assert found == [(1, ""), (2, ""), (1, "blocked")]


def test_what_moves_while_the_way_is_sought_is_told_right_after_the_plan(planner):
    assert after_the_pillar_moves(planner, (0.6, 0.0, 0.5), moves_at=10)[0] == [
        (29, 1, ""),
        (30, 1, "blocked"),
    ]


def test_what_moves_elsewhere_or_may_be_touched_does_not_matter(planner):
    assert after_the_pillar_moves(planner, (0.0, 2.0, 0.5))[0] == [(29, 1, "")]
    soft = PlanRequest(id=1, start=START, goal=GOAL, touches=["pillar"])
    assert after_the_pillar_moves(planner, (0.6, 0.0, 0.5), soft)[0] == [(29, 1, "")]


@pytest.mark.parametrize(("moves", "cause"), [(True, "occupied"), (False, "goal_in_collision")])
def test_a_place_that_something_passes_is_occupied_and_not_out_of_reach(planner, moves, cause):
    stand, _ = planner()
    drive = PlanRequest(id=2, start=[], goal=[], base=((0.0, 0.0, 0.0), (0.0, -2.0, 0.0)))
    plan = None
    for k in range(20):
        at = (0.03 * (k if moves else 5) - 0.15, -2.0, 0.5)
        _, poses = scenery((*PILLAR[:2], at))
        out = stand.update(k, poses=poses, **({"request": drive} if k == 5 else {}))
        plan = out.get("plan", plan)
    assert plan is not None
    assert plan.cause == cause
    assert plan.text.startswith("pillar is ")


BASES = [(0.0, 3.0, 0.0), (0.0, 1.5, 0.0), (0.0, 0.0, 0.0)]


def beside_a_base(planner, pillar, *, at_step=60, arrives=True, start=START):
    """Return what is planned and reported for an arm that swings while its base drives along y.

    pillar: where it is from a step on. arrives: the base ends at the last pose of the request, else
    it starts there. It is in the middle at step 58.
    """
    stand, _ = planner()
    first, last = (3.0, 0.0) if arrives else (0.0, 3.0)
    drive = PlanRequest(id=1, start=[], goal=[], base=((0.0, first, 0.0), (0.0, last, 0.0)))
    asked = PlanRequest(id=2, start=start, goal=GOAL, bases=BASES)
    found = []
    for k in range(120):
        _, poses = scenery((*PILLAR[:2], pillar if k >= at_step else (5.0, 5.0, 0.5)))
        share = min(max(0.01 * (k - 8), 0.0), 1.0)
        poses.position[0] = (0.0, first + share * (last - first), 0.0)
        new = {0: drive, 6: asked}.get(k)
        out = stand.update(k, poses=poses, **({"request": new} if new else {}))
        found += [out["plan"]] if "plan" in out and out["plan"].id == 2 else []
    return [(plan.cause, plan.text) for plan in found]


def test_what_comes_onto_a_path_beside_a_base_is_reported_where_the_base_has_yet_to_be(planner):
    planned, blocked = beside_a_base(planner, (0.6, 0.0, 0.5))
    assert (planned[0], blocked[0]) == ("", "blocked")
    assert blocked[1].startswith("pillar blocks the path 0.")


def test_what_comes_where_the_base_has_been_blocks_nothing(planner):
    assert [cause for cause, _ in beside_a_base(planner, (0.6, 3.0, 0.5))] == [""]


@pytest.mark.parametrize(("y", "causes"), [(0.0, [""]), (3.0, ["", "blocked"])])
def test_a_base_that_starts_at_its_last_pose_goes_through_them_backwards(planner, y, causes):
    found = beside_a_base(planner, (0.6, y, 0.5), arrives=False)
    assert [cause for cause, _ in found] == causes


def test_an_arm_in_a_thing_is_refused_beside_a_base_too(planner):
    ((cause, text),) = beside_a_base(planner, (0.3, 0.0, 0.5), at_step=0, start=[0.0, 0.0, 0.0])
    assert (cause, "link_0 touches pillar" in text) == ("start_collides", True)


def test_what_comes_onto_a_path_that_was_checked_is_reported(planner):
    stand, poses = planner()
    path = [[turn, 0.0, 0.0] for turn in (-0.8, -0.6)]
    stand.update(0, request=PlanRequest(id=1, start=START, goal=START, path=path), poses=poses)
    assert stand.update(4)["plan"].cause == ""
    _, moved = scenery((*PILLAR[:2], (0.5, -0.4, 0.5)))
    plan = stand.update(6, poses=moved)["plan"]
    assert (plan.id, plan.cause) == (1, "blocked")
