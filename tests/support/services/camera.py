"""A world with a camera above an orange box on a white floor, and a disc that turns."""

from pathlib import Path

import numpy as np
from support.services.control import make_config
from support.services.devices import box, joint, link, write_urdf

from stepbus_plant import Plant
from stepbus_schemas import Description, Image

DOWN = "3.141592653589793 0 0"
"""Roll, pitch, yaw of a link whose z looks down and whose x is that of its parent."""
WORLD = """
cameras:
  wrist: {link: lens, period: 10ms, near: 0.1, far: 1.5, fov: 1.0}
bodies:
  ground: {urdf: ground.urdf, position: [0.3, 0, -0.1], fixed_base: true}
  tripod: {urdf: tripod.urdf, position: [0, 0, 1], fixed_base: true}
  crate: {urdf: crate.urdf, position: [0.1, 0.05, 0.05], fixed_base: true}
"""
IMAGES = {"rgb": "Image/1", "depth": "Image/1"}


def visual(geometry: str, rgb: str, at: str = "0 0 0") -> str:
    """Return the part of a link that cameras see; rgb: 0 to 1 each."""
    return (
        f'<visual><origin xyz="{at}"/><geometry>{geometry}</geometry>'
        f'<material name="{rgb}"><color rgba="{rgb} 1"/></material></visual>'
    )


def write_scene(folder: Path, world: str = WORLD, *, tilt: str = DOWN) -> None:
    """Write the world and its models; tilt: roll, pitch, yaw of the camera [rad].

    The crate is 0.2 x 0.1 x 0.1 m. The frame of its link is its centre, that of its mass is 0.02 m
    higher.
    """
    size = box("0.2 0.1 0.1")
    crate = link("crate", 2.0, size, more=visual(size, "1 0.5 0"))
    write_urdf(folder, "crate", crate.replace('xyz="0 0 0"', 'xyz="0 0 0.02"', 1))
    floor = box("1 4 0.2")
    write_urdf(folder, "ground", link("floor", 1.0, floor, more=visual(floor, "1 1 1")))
    mount = joint("mount", "fixed", "legs", "lens", "0 0 0", "0 0 1", "0 0")
    mount = mount.replace('xyz="0 0 0"', f'xyz="0 0 0" rpy="{tilt}"', 1)
    write_urdf(
        folder, "tripod", link("legs", 1.0, box("0.01 0.01 0.01")), '<link name="lens"/>', mount
    )
    disc = link("disc", 1.0, box("0.1 0.1 0.1"))
    axle = joint("axle", "continuous", "post", "disc", "0 0 0", "0 0 1", "10 20")
    write_urdf(folder, "wheel", link("post", 1.0, box("0.01 0.01 0.01")), disc, axle)
    (folder / "world.yaml").write_text(world)


def make_plant(
    folder: Path,
    outputs: dict[str, str],
    inputs: dict[str, str] | None = None,
    *,
    seed: int = 0,
    **params: object,
) -> Plant:
    """Return a started plant of the world in a folder; outputs, inputs: port → type."""
    inputs = inputs or {}
    params = {"world": "world.yaml", **params}
    config = make_config(
        "plant", inputs, outputs, folder, params=params, seed=seed, publishes="first"
    )
    participant = Plant(config)
    participant.start({port: Description() for port in inputs})
    return participant


def colours(image: Image) -> np.ndarray:
    """Return the colours of an image, shape (height, width, 3)."""
    return np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3)


def metres(image: Image) -> np.ndarray:
    """Return the depths of an image, shape (height, width), [m]."""
    return np.frombuffer(image.data, "<f4").reshape(image.height, image.width)


def rays(image: Image) -> np.ndarray:
    """Return where each pixel looks to: x, y at depth 1, shape (height, width, 2)."""
    u, v = np.meshgrid(np.arange(image.width), np.arange(image.height))
    return (np.stack([u, v], axis=-1) - image.centre) / image.focal


def is_orange(image: Image) -> np.ndarray:
    """Return which pixels have the hue of the crate, shape (height, width)."""
    red, green, blue = np.moveaxis(colours(image).astype(int), -1, 0)
    return (blue == 0) & (red > 0) & (abs(2 * green - red) <= 2)
