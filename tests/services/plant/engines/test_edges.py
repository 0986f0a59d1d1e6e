"""Edges in images are where the documented geometry of a camera puts them, on both engines."""

import math

import numpy as np
import pytest
from support.services.camera import IMAGES, make_plant, visual, write_scene
from support.services.devices import box, link, write_urdf
from support.tools import needs_opengl

WORLD = """
cameras:
  wrist: {{link: lens, period: 10ms, near: 0.1, far: 1.5, fov: {fov}, width: {width}, height: {height}}}
bodies:
  tripod: {{urdf: tripod.urdf, position: [0, 0, 1], fixed_base: true}}
  crate: {{urdf: crate.urdf, position: [0, 0, -0.05], fixed_base: true}}
"""
NEAR_AN_EDGE = 0.07
"""Of the grid on which renderers place corners [pixel]."""


def seen(folder, engine, edges, *, yaw, **camera):
    """Return where a camera 1 m above a thin plate sees it, shape (height, width)."""
    needs_opengl(engine)
    write_scene(folder, WORLD.format(**camera), tilt=f"{math.pi} 0 {yaw}")
    x0, x1, y0, y1 = edges
    plate = visual(
        box(f"{x1 - x0} {y1 - y0} 0.001"), "1 0.5 0", f"{(x0 + x1) / 2} {(y0 + y1) / 2} 0.0495"
    )
    write_urdf(folder, "crate", link("crate", 2.0, box("0.01 0.01 0.01"), more=plate))
    depth = make_plant(folder, IMAGES, engine=engine).output(None)["depth"]
    return np.isfinite(np.frombuffer(depth.data, "<f4").reshape(depth.height, depth.width))


@pytest.mark.parametrize("seed", range(6))
def test_a_plate_covers_the_pixels_whose_middle_it_covers(tmp_path, engine, seed):
    rng = np.random.default_rng(seed)
    width, height = [(64, 64), (64, 48), (33, 21)][seed % 3]
    fov, yaw = float(rng.uniform(0.6, 1.6)), float(rng.choice([0.0, 0.3, math.pi / 2, math.pi]))
    edges = [float(rng.uniform(low, low + 0.3)) for low in (-0.4, 0.0, -0.3, 0.1)]
    # A pinhole: the middle of a pixel is (column - (width - 1) / 2) / f to the right, 1 ahead.
    f = height / 2 / math.tan(fov / 2)
    right = (np.arange(width) - (width - 1) / 2)[np.newaxis, :] / f
    up = -(np.arange(height) - (height - 1) / 2)[:, np.newaxis] / f
    x, y = math.cos(yaw) * right - math.sin(yaw) * up, math.sin(yaw) * right + math.cos(yaw) * up
    inside = (x > edges[0]) & (x < edges[1]) & (y > edges[2]) & (y < edges[3])
    gaps = np.abs([x - edges[0], x - edges[1], y - edges[2], y - edges[3]]).min(axis=0)
    found = seen(tmp_path, engine, edges, yaw=yaw, fov=fov, width=width, height=height)
    assert 0 < inside.sum() < inside.size
    assert not ((found != inside) & (gaps * f > NEAR_AN_EDGE)).any()
