"""What messages add to a scene."""

import pytest

from stepbus_schemas import Contacts, Description, Detections
from stepbus_tools.viewing.scene.bodies import Latest
from stepbus_tools.viewing.scene.scene import Frame, Scene
from stepbus_tools.viewing.stage.overlays import Overlays
from stepbus_tools.viewing.stage.server import open_page
from stepbus_tools.viewing.stage.stage import Stage


class Port:
    description, names = Description(), ()

    def __init__(self, topic, type_name):
        self.topic, self.type = topic, type_name


@pytest.fixture
def page():
    page = open_page("test")
    yield page
    page.close()


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
    assert find("/shown/d.d/0/type") is not None
    overlays.switch(visible=False)
    assert not find("/shown/c.c").visible
    overlays.show({"d/d": Latest(step=2, message=nothing)})
    assert find("/shown/c.c") is None
    assert find("/shown/d.d/0") is None
