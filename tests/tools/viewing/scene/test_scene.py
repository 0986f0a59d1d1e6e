"""What a recording shows, from nothing but itself."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.meshes import mesh_file
from stepbus_tools.viewing.scene.pose import Pose


@pytest.fixture(scope="module")
def two_link(tmp_path_factory):
    """A recording of the two-link arm, with the true pose of its tip."""
    scenario = load("two_link/tip", ["duration=300ms"])
    out = tmp_path_factory.mktemp("scene") / "run"
    return Recording(run(scenario, Options(out=out, host=InProcess())).recording)


def latest(recording, scene, t_ns):
    return History(recording).at(scene.topics, t_ns)


def with_attachments(recording, attachments):
    same = {key: getattr(recording, key) for key in ("path", "ports", "scenario")}
    return SimpleNamespace(**same, attachments=attachments)


def test_the_joints_put_the_tip_where_the_plant_says_it_is(two_link):
    scene = build_scene(two_link)
    for step in (0, 31, 60):
        messages = latest(two_link, scene, step * 5_000_000)
        _, true = two_link["plant.tip"].latest(step * 5_000_000)
        tip = scene.world_poses(messages)["arm/link2"] @ Pose((1.0, 0.0, 0.0))
        assert np.allclose(tip.position, true.position[0], atol=1e-6)


def test_targets_are_a_second_robot(two_link):
    scene = build_scene(two_link)
    messages = latest(two_link, scene, 10**18)
    wanted = messages["mission/reference"].message.position
    ghosts = [frame for frame in scene.frames if frame.is_ghost and frame.visuals]
    assert {frame.ghost_of for frame in ghosts} == {"arm/link1", "arm/link2"}
    moved = scene.poses(messages)
    link = next(frame for frame in scene.frames if frame.name == "target/arm/link1")
    assert moved[link.name].wxyz[0] == pytest.approx(math.cos(wanted[0] / 2), abs=1e-6)


def test_the_newest_message_of_a_time_is_found_without_reading_all(two_link):
    port = two_link["plant.joint_state"]
    for step, message in port.messages():
        assert port.latest(step * 5_000_000) == (step, message)
        assert port.latest(step * 5_000_000 + 4_999_999) == (step, message)
    assert port.latest(-1) is None


def test_without_its_scenario_a_recording_still_shows_what_its_messages_say(two_link):
    scene = build_scene(with_attachments(two_link, {}))
    assert "contains no scenario" in scene.notes[0]
    assert any(frame.visuals for frame in scene.frames) or "to draw" in scene.notes[-1]


def test_a_missing_mesh_is_a_box_and_a_sentence(two_link):
    urdf = two_link.attachments["files/two_link.urdf"]
    assert b"<box" in urdf
    start, end = urdf.index(b"<box"), urdf.index(b"/>", urdf.index(b"<box")) + 2
    changed = urdf[:start] + b'<mesh filename="gone.stl"/>' + urdf[end:]
    attachments = {**two_link.attachments, "files/two_link.urdf": changed}
    scene = build_scene(with_attachments(two_link, attachments))
    assert any("no mesh gone.stl" in note for note in scene.notes)
    assert any(frame.visuals for frame in scene.frames)


def test_a_collada_mesh_in_millimetres_is_drawn_in_metres(tmp_path):
    path = tmp_path / "part.dae"
    text = trimesh.creation.box((1000.0, 2000.0, 3000.0)).export(file_type="dae").decode()
    path.write_text(text.replace("<up_axis>", '<unit meter="0.001"/><up_axis>'))
    (mesh,) = mesh_file(path, (1.0, 1.0, 1.0))
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx((1.0, 2.0, 3.0))
