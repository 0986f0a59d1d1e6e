"""One sale of the store, end to end, as its README promises it."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.runs.store import NAMES, last, moves, store, texts

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.scenario.load import load

pytestmark = pytest.mark.slow

ITEM = "cola_a1_1"
ROW = re.compile(rf"^1 +{ITEM} +1 +- +(?P<placed>[\d.]+) mm +-", re.MULTILINE)
ARM = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "ee")
EFFORT = np.array([150.0, 150.0, 150.0, 28.0, 28.0, 28.0])
"""Limits of the UR5's motors [N·m]."""


@pytest.fixture(scope="module")
def sale(tmp_path_factory):
    """Return the result of a sale with the camera in the loop."""
    return store(tmp_path_factory.mktemp("sale"), scenario="store", in_process=False)


@pytest.fixture(scope="module")
def recording(sale):
    return Recording(Path(sale.folder) / "run.mcap")


@pytest.mark.timeout(600)
def test_the_item_is_sold(sale, recording):
    assert sale.exit_code == 0, sale.reason
    row = ROW.search("\n".join(texts(recording, "mission/summary")))
    assert float(row["placed"]) < 10.0


@pytest.mark.timeout(600)
def test_the_item_stands_where_the_camera_has_seen_it(recording):
    row = ROW.search("\n".join(texts(recording, "mission/summary")))
    number = recording.ports["plant/poses"].description.names.index(ITEM)
    x, y, z = last(recording, "plant/poses").position[number]
    away = np.hypot(x - 0.15, y - 0.65)
    assert away < 0.01
    assert away * 1e3 == pytest.approx(float(row["placed"]), abs=5.0)
    assert z == pytest.approx(0.35, abs=2e-3)


@pytest.mark.timeout(600)
def test_nobody_reads_the_truth():
    sources = [
        f"{source.source}.{source.port}"
        for row in load("store").participants
        for source in row.inputs.values()
    ]
    assert "plant.planogram" in sources
    assert "plant.poses" not in sources


@pytest.mark.timeout(600)
def test_no_other_item_has_moved(recording):
    others = {name: way for name, way in moves(recording).items() if name != ITEM}
    assert len(others) == 41
    assert max(others.values()) < 2e-3


@pytest.mark.timeout(600)
def test_it_is_held_by_as_much_friction_as_its_weight_needs_and_does_not_slip(recording):
    held = [state for _, state in recording.messages("plant/gripper") if state.holding]
    forces = [command.force for _, command in recording.messages("controller/gripper")]
    assert max(state.slip for state in held) < 1e-3
    assert 6.0 <= np.median([state.force for state in held]) < 12.0
    assert max(forces) <= 15.0


@pytest.mark.timeout(600)
def test_what_it_weighs_is_in_the_requests_for_plans(recording):
    loads = [request.load for _, request in recording.messages("controller/plan_request")]
    weights = [load for load in loads if load > 0.0]
    assert len(weights) >= 3
    # The cola of this slot, to a centigram of the scale's resolution: 0.35 kg ± 3 %.
    assert weights == pytest.approx([0.35] * len(weights), abs=0.025)


@pytest.mark.timeout(600)
def test_the_arm_touches_nothing_and_its_motors_suffice(recording):
    arm = {f"{name}_link" for name in ARM}
    touched = [
        pair
        for _, contacts in recording.messages("plant/contacts")
        for pair, force in zip(contacts.pairs, contacts.force, strict=True)
        if force > 0.0 and not arm.isdisjoint(pair)
    ]
    assert touched == []
    efforts = [np.abs(state.effort) for _, state in recording.messages("plant/joint_state")]
    assert (np.max(efforts, axis=0) < EFFORT).all()


@pytest.mark.timeout(600)
def test_the_commands_of_the_base_keep_its_limits(recording):
    params = load("store").participant("controller").params
    for field, name in (("vx", "base"), ("wz", "base_turn")):
        rates = np.diff(recording["controller/base"][field]) / 0.016
        assert np.abs(rates).max() <= 1.02 * params[f"{name}_acceleration"]
        assert np.abs(np.diff(rates) / 0.016).max() <= 1.02 * params[f"{name}_jerk"]


@pytest.mark.timeout(600)
def test_a_second_run_with_another_window_is_equal_to_the_byte(sale, tmp_path):
    again = store(
        tmp_path, "window=8", "batch=4", "bus.transport=tcp", scenario="store", in_process=False
    )
    assert again.sha256 == sale.sha256


@pytest.mark.timeout(600)
def test_a_run_in_one_process_is_equal_to_the_byte(sale, tmp_path):
    assert store(tmp_path, scenario="store").sha256 == sale.sha256


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", NAMES)
def test_each_participant_does_again_what_it_did(sale, name):
    result = replay(Path(sale.folder) / "run.mcap", name)
    assert result.equal, result.divergence


@pytest.mark.timeout(600)
def test_several_orders_are_sold_in_a_row(tmp_path):
    result = store(tmp_path, "mission.params.orders=[{item: water_b3_3}, juice]")
    assert result.exit_code == 0, result.reason
    assert "2 of 2 sales" in "\n".join(
        texts(Recording(Path(result.folder) / "run.mcap"), "mission/summary")
    )


def test_a_command_that_hosts_the_sale_leaves_no_complaint_of_a_library_at_its_end(tmp_path):
    words = ["run", "store", "--in-process", "--no-report", "--set", "duration=160ms"]
    command = [sys.executable, "-P", "-m", "stepbus_orchestrator.cli", *words]
    done = subprocess.run(
        command, cwd=tmp_path, check=False, capture_output=True, text=True, timeout=120
    )
    assert "recording " in done.stdout + done.stderr
    assert "leaked" not in done.stderr
