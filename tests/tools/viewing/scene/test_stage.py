"""What a stage shows besides the scene: ghosts of targets, and what messages add."""

import types

import pytest

from stepbus_schemas import Contacts, Description, Detections
from stepbus_tools.viewing.scene.pose import Pose, about
from stepbus_tools.viewing.scene.scene import Frame, Latest, Scene
from stepbus_tools.viewing.stage.overlays import Overlays
from stepbus_tools.viewing.stage.stage import Ghosts, Stage

Z = (0.0, 0.0, 1.0)


@pytest.fixture
def mesh():
    return types.SimpleNamespace(visible=True)


@pytest.fixture
def ghosts(mesh):
    return Ghosts({"target/arm/link": [mesh]}, {"target/arm/link": "arm/link"})


def poses(x=0.0, yaw=0.0):
    return {"arm/link": Pose(), "target/arm/link": Pose((x, 0.0, 0.0), about(Z, yaw))}


@pytest.mark.parametrize("far", [poses(x=0.02), poses(yaw=0.03), {"target/arm/link": Pose()}])
def test_a_ghost_is_shown_where_its_link_is_not(ghosts, mesh, far):
    ghosts.compare(poses())
    assert not mesh.visible
    ghosts.compare(far)
    assert mesh.visible


def test_a_ghost_does_not_flicker(ghosts, mesh):
    ghosts.compare(poses(x=0.007))
    assert mesh.visible
    ghosts.compare(poses(x=0.004))
    ghosts.compare(poses(x=0.007))
    assert not mesh.visible


def test_ghosts_that_are_switched_off_stay_so(ghosts, mesh):
    ghosts.show(visible=False)
    ghosts.compare(poses())
    ghosts.compare(poses(x=0.1))
    assert not mesh.visible
    ghosts.show(visible=True)
    assert mesh.visible


class Port:
    description, names = Description(), ()

    def __init__(self, topic, type_name):
        self.topic, self.type = topic, type_name


def test_what_was_seen_stays_where_the_camera_was_then(page):
    class Moving(Scene):
        def world_poses(self, messages):
            return {"eye": Pose((float(messages["at"].step), 0.0, 0.0))}

    scene = Moving(frames=[Frame(name="eye")], motions=[])
    overlays = Overlays(
        page.server, Stage(page.server, scene), {"d/d": Port("d/d", "Detections/1")}
    )
    seen = Detections(
        frame="eye", types=["x"], position=[(1, 0, 0)], orientation=[(0, 0, 0, 1)], confidence=[1]
    )
    now = {"d/d": Latest(step=3, message=seen), "at": Latest(step=9, message=seen)}
    overlays.show(now, lambda step: {"at": Latest(step=step, message=seen)})
    assert page.server.scene.get_handle_by_name("/shown/d.d/0").position[0] == 4.0


def test_what_is_seen_and_touched_comes_and_goes(page):
    stage = Stage(page.server, Scene(frames=[Frame(name="a")], motions=[]))
    ports = {port.topic: port for port in (Port("c/c", "Contacts/1"), Port("d/d", "Detections/1"))}
    overlays, find = Overlays(page.server, stage, ports), page.server.scene.get_handle_by_name
    touched = Contacts(pairs=[("a", "b")], force=[5.0], distance=[0.0], position=[(0, 0, 0)])
    seen = Detections(
        frame="a", types=["x"], position=[(1, 0, 0)], orientation=[(0, 0, 0, 1)], confidence=[1]
    )
    nothing = Detections(frame="a", types=[], position=[], orientation=[], confidence=[])
    rows = {"c/c": Latest(step=1, message=touched), "d/d": Latest(step=1, message=seen)}
    overlays.show(rows)
    assert find("/shown/c.c") is not None
    assert find("/shown/d.d/0").visible
    overlays.switch(visible=False)
    assert not find("/shown/c.c").visible
    overlays.show({"d/d": Latest(step=2, message=nothing)})
    assert find("/shown/c.c") is None
    assert find("/shown/d.d/0") is None
