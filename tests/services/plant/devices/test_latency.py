import pytest
from support.services.camera import IMAGES, WORLD, make_plant, write_scene
from support.services.control import Stand
from support.tools import needs_opengl

from stepbus_plant.engines import ENGINES, is_here
from stepbus_schemas import CameraTrigger

FALLING = WORLD.replace("0.05], fixed_base: true", "0.4]")
SLOW = FALLING.replace("period: 10ms", "period: 10ms, latency: 15ms")
ERRORS = {"color": 4, "depth": 0.004, "blur": 0.7, "light": "lamp"}


def standing(folder, world, outputs=IMAGES, *more, **params):
    write_scene(folder, world)
    return Stand(make_plant(folder, outputs, *more, **params))


def shown(folder, world, **params):
    """Return the messages of each step."""
    stand = standing(folder, world, **params)
    return [stand.update(step) for step in range(12)]


def test_images_with_a_latency_are_those_without_but_later(tmp_path):
    now = shown(tmp_path, FALLING, camera=ERRORS)
    late = shown(tmp_path, SLOW, camera=ERRORS)
    assert [step for step, row in enumerate(late) if "rgb" in row] == [3, 5, 7, 9, 11]
    for step in range(0, 9, 2):
        assert (late[step + 3]["rgb"], late[step + 3]["depth"]) == (
            now[step]["rgb"],
            now[step]["depth"],
        )
    assert now[0]["depth"] != now[8]["depth"]


def test_an_image_on_request_has_its_latency_too(tmp_path):
    stand = standing(tmp_path, SLOW, IMAGES, {"wrist": "CameraTrigger/1"})
    stand.update(0, wrist=CameraTrigger(id=1))
    assert [step for step in range(1, 8) if "rgb" in stand.update(step)] == [4]


@pytest.mark.parametrize("engine", [name for name in ENGINES if is_here(name)])
def test_the_renderer_is_known(tmp_path, engine):
    needs_opengl(engine)
    versions = standing(tmp_path, WORLD, engine=engine).participant.versions()
    assert f"{engine} {versions[engine]}" in versions["renderer"]
    blind = standing(tmp_path, WORLD, {"state": "JointState/1"}).participant
    assert "renderer" not in blind.versions()
