"""Two of any robot that ships work in one world: each has its own names behind a prefix."""

import json
import shutil

import pytest
from support.runs.patience import patient

from stepbus_orchestrator import cli
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.extend import read_extended
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.locate import locate
from stepbus_participant.parameters import parse_yaml
from stepbus_tools.signals import read_tracking, tracking_rmse

SIDES = ("left", "right")
DEVICES = {
    "odometry": "base", "gripper": "gripper", "contacts": "contacts", "imu": "imu",
    "front": "front", "back": "back",
}  # fmt: skip
"""Outputs of the plant of which each robot has its own → the device that they are named after."""


def origin(source, side):
    """Return where an input of one side comes from."""
    if isinstance(source, dict):
        return {**source, "from": origin(source["from"], side)}
    name, port = source.split(".")
    if name != "plant":
        return f"{side}_{name}.{port}"
    return f"plant.{side}_{DEVICES[port]}" if port in DEVICES else source


def both(row, make):
    """Return a map with both sides of its entries."""
    return {key: value for side in SIDES for key, value in make(row, side)}


def plant_of(row):
    def outputs(row, side):
        for port, type_ in row.items():
            yield (f"{side}_{DEVICES[port]}" if port in DEVICES else port), type_

    def inputs(row, side):
        yield from ((f"{side}_{port}", origin(source, side)) for port, source in row.items())

    params = {**row["params"], "world": "world.yaml"}
    for key in ("joints", "poses"):
        if key in params:
            params[key] = [f"{side}/{name}" for side in SIDES for name in params[key]]
    if "effort" in params:
        params["effort"] = both(
            params["effort"], lambda row, side: [(f"{side}/{k}", v) for k, v in row.items()]
        )
    return {
        **row,
        "inputs": both(row["inputs"], inputs),
        "outputs": both(row["outputs"], outputs),
        "params": params,
    }


def doubled(folder, file, world_file, body, apart):
    """Write a scenario with two of a robot, the second one moved by `apart` [m]."""
    data, source = read_extended(file).data, file.parent
    rows = {"plant": plant_of(data["participants"]["plant"])}
    for name, row in data["participants"].items():
        if name != "plant" and row is not None:
            for side in SIDES:
                inputs = {p: origin(s, side) for p, s in row.get("inputs", {}).items() if s}
                params = {**row["params"], "prefix": f"{side}/"}
                rows[f"{side}_{name}"] = {**row, "inputs": inputs, "params": params}
    shutil.copytree(source, folder, ignore=shutil.ignore_patterns("*.md", "__pycache__"))
    world = parse_yaml(world_file, (source / world_file).read_text())
    robot = world["bodies"].pop(body)
    at = robot.get("position", [0, 0, 0])
    moved = {**robot, "position": [a + b for a, b in zip(at, apart, strict=True)]}
    world["bodies"] |= {"left": robot, "right": moved}
    for section in ("bases", "grippers", "contacts", "cameras", "imus", "lidars"):
        world[section] = both(world.get(section, {}), _devices)
    (folder / "world.yaml").write_text(json.dumps(world))
    (folder / "two.yaml").write_text(json.dumps({**data, "name": "two", "participants": rows}))
    return folder / "two.yaml"


def _devices(rows, side):
    for name, row in rows.items():
        device = {
            key: f"{side}/{value}"
            if key in ("left", "right", "link")
            else [f"{side}/{link}" for link in value]
            if key == "links"
            else value
            for key, value in row.items()
        }
        yield f"{side}_{name}", device


def patient_run(file, duration, out):
    """Run a scenario in one process, on a machine of any speed."""
    loaded = load(file, patient(file, f"duration={duration}"))
    return run(loaded, Options(out=out, host=InProcess()))


def test_two_baxters_follow_their_references_in_one_world(tmp_path):
    file = doubled(tmp_path / "two", locate("baxter"), "world.yaml", "baxter", [0, 2, 0])
    result = patient_run(file, "1s", tmp_path / "run")
    assert (result.exit_code, result.steps) == (0, 20), result.reason
    rmse = tracking_rmse(read_tracking(Recording(result.recording)), 0.0)
    assert len(rmse) == 28
    assert {joint.partition("/")[0] for joint in rmse} == set(SIDES)
    assert max(rmse.values()) < 0.02


def test_two_baxters_go_to_poses_in_one_world(tmp_path):
    file = locate("baxter/round_trip")
    file = doubled(tmp_path / "two", file, "round_trip_world.yaml", "baxter", [0, 2, 0])
    result = patient_run(file, "2s", tmp_path / "run")
    assert (result.exit_code, result.steps) == (0, 40), result.reason
    with Recording(result.recording) as recording:
        for side in SIDES:
            states = {m.state for _, m in recording.messages(f"{side}_controller/goal_status")}
            assert "running" in states
            assert "failed" not in states


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_two_robots_of_the_store_work_in_one_world(tmp_path):
    file = doubled(tmp_path / "two", locate("store/truth"), "world.yaml", "robot", [-4, 0, 0])
    assert cli.main(["validate", str(file)]) == 0
    result = patient_run(file, "1600ms", tmp_path / "run")
    assert result.exit_code == 0, result.reason
    with Recording(result.recording) as recording:
        for side in SIDES:
            goals = [m for _, m in recording.messages(f"{side}_mission/goal")]
            states = {m.state for _, m in recording.messages(f"{side}_controller/goal_status")}
            assert goals
            assert "running" in states
