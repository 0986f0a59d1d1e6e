import os
from contextlib import contextmanager

import psutil
import pytest
from support.services.camera import IMAGES, WORLD, make_plant, write_scene
from support.services.control import Stand
from support.tools import needs_opengl, needs_pybullet

from stepbus_plant import drawing
from stepbus_plant.camera import Camera
from stepbus_plant.engines import ENGINES, is_here
from stepbus_schemas import CameraTrigger, RunError

FALLING = WORLD.replace("0.05], fixed_base: true", "0.4]")
SLOW = FALLING.replace("period: 10ms", "period: 10ms, latency: 15ms")
TWO = FALLING.replace(
    "fov: 1.0}", "fov: 1.0}\n  other: {link: lens, period: 10ms, near: 0.1, far: 1.5, fov: 0.5}"
)
COPIED = {"engine": "pybullet"}
"""Params of a plant that draws in copies of its process."""
ERRORS = {"color": 4, "depth": 0.004, "blur": 0.7, "light": "lamp"}


KNOWN = set()
"""Processes that were there before the test."""


@pytest.fixture(autouse=True)
def _several_cores(monkeypatch):
    KNOWN.clear()
    KNOWN.update(copies())
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: {0, 1})


@contextmanager
def standing(folder, world, outputs=IMAGES, *more, **params):
    """Yield a plant that is closed in the end."""
    write_scene(folder, world)
    stand = Stand(make_plant(folder, outputs, *more, **params))
    try:
        yield stand
    finally:
        stand.participant.close()
    assert copies() == []


def shown(folder, world, outputs=IMAGES, steps=12, **params):
    """Return the messages of each step."""
    with standing(folder, world, outputs, **params) as stand:
        return [stand.update(step) for step in range(steps)]


def copies():
    """Return the processes that the test has started and not waited for."""
    return sorted({child.pid for child in psutil.Process().children()} - KNOWN)


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


@pytest.mark.parametrize("cores", [{0}, {0, 1}])
def test_where_no_further_process_may_be_started_they_are_the_same(tmp_path, monkeypatch, cores):
    def refuse():
        raise BlockingIOError("Resource temporarily unavailable")

    two = shown(tmp_path, SLOW)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: cores)
    monkeypatch.setattr(os, "fork", None if len(cores) == 1 else refuse)
    assert shown(tmp_path, SLOW) == two


@pytest.mark.slow
@needs_pybullet
def test_cameras_drawn_at_once_see_what_they_see_one_by_one(tmp_path, monkeypatch):
    ports = {"wrist_rgb": "Image/1", "other_depth": "Image/1", "other_points": "PointCloud/1"}
    forks, fork = [], os.fork
    monkeypatch.setattr(os, "fork", lambda: forks.append(1) or fork())
    monkeypatch.setattr(drawing, "_WORTH_S", 0.0)
    at_once = shown(tmp_path, TWO, ports, **COPIED)
    assert len(forks) == 5  # the first images say how long it takes
    monkeypatch.setattr(drawing, "_WORTH_S", 10.0)
    assert shown(tmp_path, TWO, ports, **COPIED) == at_once
    assert len(forks) == 5


def test_an_image_on_request_has_its_latency_too(tmp_path):
    with standing(tmp_path, SLOW, IMAGES, {"wrist": "CameraTrigger/1"}) as stand:
        stand.update(0, wrist=CameraTrigger(id=1))
        assert [step for step in range(1, 8) if "rgb" in stand.update(step)] == [4]


LARGE = FALLING.replace("fov: 1.0", "fov: 1.0, latency: 5ms, width: 3000, height: 3000")


@needs_pybullet
def test_an_error_in_a_copy_is_one_error(tmp_path, monkeypatch):
    monkeypatch.setattr(Camera, "pixels", lambda *_: 1 / 0)
    with standing(tmp_path, SLOW, **COPIED) as stand:
        for step in range(3):
            stand.update(step)
        with pytest.raises(RunError, match="image of 0 s: ZeroDivisionError"):
            stand.update(3)


@needs_pybullet
def test_a_plant_leaves_no_copy_behind(tmp_path):
    with standing(tmp_path, LARGE.replace("latency: 5ms", "latency: 50ms"), **COPIED) as stand:
        stand.update(0)
        assert len(copies()) == 1


@pytest.mark.slow
@needs_pybullet
def test_however_long_the_latency_there_are_few_copies(tmp_path):
    late = FALLING.replace("period: 10ms", "period: 5ms, latency: 100ms")
    now = shown(tmp_path, FALLING.replace("period: 10ms", "period: 5ms"), steps=4, **COPIED)
    with standing(tmp_path, late, **COPIED) as stand:
        counts = []
        for step in range(20):
            assert "rgb" not in stand.update(step)
            counts.append(len(copies()))
        assert max(counts) == counts[-1] == 4
        assert [stand.update(step)["rgb"] for step in range(20, 24)] == [row["rgb"] for row in now]


@pytest.mark.parametrize("engine", [name for name in ENGINES if is_here(name)])
def test_the_renderer_is_known(tmp_path, engine):
    needs_opengl(engine)
    with standing(tmp_path, WORLD, engine=engine) as stand:
        versions = stand.participant.versions()
    assert f"{engine} {versions[engine]}" in versions["renderer"]
    with standing(tmp_path, WORLD, {"state": "JointState/1"}) as stand:
        assert "renderer" not in stand.participant.versions()
