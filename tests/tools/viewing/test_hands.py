"""What a user changes on the page of a run, with mouse and keyboard, and that a rerun repeats."""

import math
import shutil

import numpy as np
import pytest
from support.browser import needs_chromium, opened
from support.paused import Paused, calls_of, followed

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.locate import locate
from stepbus_tools.viewing.run_client import newest

FRAME = "getComputedStyle(document.body, '::after').borderTopWidth"
CRATE = """<robot name="crate"><link name="crate">
<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
</inertial>
<visual><geometry><box size="0.4 0.4 0.4"/></geometry></visual>
<collision><geometry><box size="0.4 0.4 0.4"/></geometry></collision></link></robot>"""


def with_crate(folder):
    """two_link with a crate beside it, that a plant reports the pose of."""
    source = locate("two_link").parent
    shutil.copytree(source, folder)
    (folder / "crate.urdf").write_text(CRATE)
    world = (folder / "world.yaml").read_text()
    crate = "  crate: {urdf: crate.urdf, fixed_base: true, position: [0, 2, 0]}\n"
    (folder / "world.yaml").write_text(world + crate)
    scenario = (folder / "scenario.yaml").read_text()
    ports = "{joint_state: JointState/1"
    assert ports in scenario
    (folder / "scenario.yaml").write_text(scenario.replace(ports, f"{ports}, poses: Poses/1"))
    return load(folder / "scenario.yaml", ["duration=100ms"])


def again(result, folder):
    return Preparation(result.recording, folder).run().result.sha256


def looked_at(page, watched, point, away):
    """Let the viewer stand at `point` + `away`; returns pixels of a vector in the image plane."""
    (client,) = page.server.get_clients().values()
    with client.atomic():
        client.camera.position = tuple(np.add(point, away))
        client.camera.look_at = tuple(point)
    size = watched.page.viewport_size
    return size["height"] / 2 / math.tan(client.camera.fov / 2) / math.dist((0, 0, 0), away)


def steering(watched, paused):
    """Return the page and the mouse, once the page of a run offers what can be changed."""
    paused.pace.step(3)
    watched.wait(lambda: watched.page.get_by_text("step 3 of").count() > 0, "step 3")
    watched.page.get_by_role("tab", name="Steer").click()
    watched.wait(lambda: watched.page.get_by_text("place").count() > 0, "what can be changed")
    return watched.page, watched.page.mouse


def test_of_a_slider_that_is_dragged_the_newest_position_counts():
    moves = [("mission", "set_target", (joint, x)) for joint, x in (("a", 1), ("a", 2), ("b", 3))]
    stop = ("plant", "emergency_stop", (True, "the user of the page"))
    assert newest([*moves, stop, *moves[:2]]) == [*moves[1:], stop, moves[1]]


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(600)
def test_a_body_is_dragged_and_a_robot_stopped_on_the_page(tmp_path, page):
    paused = Paused(tmp_path / "run", with_crate(tmp_path / "own"))
    with opened(page.address, 1100, 600) as watched, followed(paused, page):
        shown, mouse = steering(watched, paused)
        per_m = looked_at(page, watched, (0.0, 2.0, 0.0), (0.0, -2.0, 0.3))

        def is_taken():
            mouse.click(550, 300)
            return "crate" in watched.values()

        def is_put():
            # The arrow along x is to the right; the page may be too busy to have drawn it yet.
            mouse.move(550 + 0.25 * per_m, 300)
            mouse.down()
            mouse.move(550 + 0.5 * per_m, 300, steps=8)
            mouse.up()
            shown.get_by_text("place").click()
            said = shown.get_by_text("plant move_body crate")
            watched.wait(lambda: said.count() > 0, "the move")
            return float(said.first.inner_text().split("move_body crate ")[1].split()[0]) > 0.1

        watched.wait(is_taken, "the crate to be taken")
        watched.wait(is_put, "the crate to be put elsewhere")
        shown.get_by_role("button", name="emergency stop").click()
        watched.wait(lambda: shown.get_by_text("emergency_stop True").count() > 0, "the stop")
        paused.pace.step(2)
        banner = shown.locator(".stopped[role=alert]")
        watched.wait(lambda: banner.count() > 0, "the banner")
        assert "by the user of the page, since t = 0.0" in banner.inner_text()
        assert shown.evaluate(FRAME) == "10px"
        assert shown.get_by_role("button", name="release").count() == 1
        assert shown.get_by_role("button", name="emergency stop").count() == 0
        shown.get_by_role("button", name="resume").click()
        watched.wait(lambda: not paused.thread.is_alive(), "the run to end")
        assert not watched.errors
        assert not watched.strangers
    *_, (move, name, x, y, z, yaw), stop = calls_of(paused.result)
    assert (move, name) == ("move_body", "crate")
    assert 0.1 < x < 0.5
    assert (y, z, yaw) == pytest.approx((2.0, 0.0, 0.0), abs=0.02)
    assert stop == ("emergency_stop", True, "the user of the page")
    with Recording(paused.result.recording) as recording:
        poses = recording["plant.poses"]
        assert poses.position[-1, poses.names.index("crate")] == pytest.approx((x, y, z), abs=1e-4)
        assert abs(recording["plant.joint_state"].velocity[-1]).max() < 0.05
    assert again(paused.result, tmp_path / "again") == paused.result.sha256


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(600)
def test_an_arrow_that_is_let_go_pushes_a_link(tmp_path, page):
    paused = Paused(tmp_path / "run", load("two_link", ["duration=100ms"]))
    with opened(page.address, 1100, 600) as watched, followed(paused, page):
        shown, mouse = steering(watched, paused)
        shown.get_by_label("push", exact=True).first.click()
        shown.get_by_role("option", name="arm/link1").click()
        per_m = looked_at(page, watched, (0.0, 0.0, 0.0), (0.0, -2.0, 0.3))

        def is_pushed():
            mouse.move(550 + 0.25 * per_m, 300)
            mouse.down()
            mouse.move(550 + 0.5 * per_m, 300, steps=8)
            mouse.up()
            return shown.get_by_text("plant push arm/link1").count() > 0

        watched.wait(is_pushed, "the push")
        shown.get_by_role("button", name="resume").click()
        watched.wait(lambda: not paused.thread.is_alive(), "the run to end")
        assert not watched.errors
    name, link, force, over, more = calls_of(paused.result)[0]
    assert (name, link, over, more) == ("push", "arm/link1", "100ms", {"point": [0, 0, 0]})
    assert 1.0 < np.linalg.norm(force) < 100.0
    assert again(paused.result, tmp_path / "again") == paused.result.sha256
