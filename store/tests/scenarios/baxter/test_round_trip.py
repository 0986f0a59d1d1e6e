"""The round trip of Baxter's hands: what arrives, what is named beforehand, and twice the same."""

import re

import msgpack
import pytest
from support.messages.recordings import messages

from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load

# So weak a shoulder cannot hold many poses.
WEAK = ["seed=3", "plant.params.effort.left_s1=40", "plant.params.effort.right_s1=40"]


def round_trip(folder, *overrides, in_process=True):
    scenario = load("baxter/round_trip", ["mission.params.poses=2", *overrides])
    return run(scenario, Options(out=folder, host=host_of(in_process=in_process)))


def told(result, port):
    rows = [data for topic, _, _, data in messages(result.recording) if topic == f"mission/{port}"]
    return [line for row in rows for line in msgpack.unpackb(row)["text"].splitlines()]


@pytest.fixture(scope="module")
def strong(tmp_path_factory):
    return round_trip(tmp_path_factory.mktemp("strong") / "out")


@pytest.fixture(scope="module")
def weak(tmp_path_factory):
    return round_trip(tmp_path_factory.mktemp("weak") / "out", *WEAK)


def test_every_pose_comes_within_a_millimetre_and_half_a_degree(strong):
    assert strong.exit_code == 0, strong.reason
    found = [
        re.fullmatch(r"(left|right) \d/2: ([\d.]+) mm, ([\d.]+)°", row)
        for row in told(strong, "events")
    ]
    arrived = [(m[1], float(m[2]), float(m[3])) for m in found if m]
    assert sorted(arm for arm, _, _ in arrived) == ["left", "left", "right", "right"]
    assert all(mm < 1 and degrees < 0.5 for _, mm, degrees in arrived)


def test_the_summary_has_a_sentence_for_each_arm(strong):
    rows = told(strong, "summary")
    assert [row.partition(":")[0] for row in rows] == ["left", "right"]
    assert all("2 of 2 poses within 10 mm" in row for row in rows)


def test_with_weak_shoulders_exactly_the_named_poses_are_missed(weak):
    assert weak.exit_code == 0, weak.reason
    named = [row for row in told(weak, "events") if "needs" in row and "N·m and has 40.0" in row]
    missed = [row for row in told(weak, "events") if row.split("; ")[0].endswith("not settled")]
    label = re.compile(r"(left|right) \d/2: ")
    assert named
    assert [label.match(row)[0] for row in named] == [label.match(row)[0] for row in missed]
    assert all("0 missed without being named" in row for row in told(weak, "summary"))


@pytest.mark.slow
def test_a_run_in_separate_processes_is_the_same_to_the_byte(strong, tmp_path):
    assert round_trip(tmp_path / "out", in_process=False).sha256 == strong.sha256
