"""The images of a camera."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import Image, Quaternion, RunError


def turn_about_z(yaw: float) -> Quaternion:
    """Return the quaternion x, y, z, w of a rotation about z [rad]."""
    return (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


_CHANNELS = {"rgb8": ("u1", 3), "32FC1": ("<f4", 1)}


@dataclass(frozen=True, kw_only=True)
class View:
    """A colour and a depth image of one camera at one time.

    rgb: shape (h, w, 3), bytes. depth: along the optical axis, shape (h, w) [m]. focal: focal
    lengths x, y [pixel]. centre: principal point x, y [pixel]; the centre of the first pixel is at
    (0, 0).
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float64]
    focal: tuple[float, float]
    centre: tuple[float, float]


def make_view(images: dict[str, Image]) -> View:
    """Return a colour and a depth image as a view; images: by input port.

    Raises RunError for images that do not match or are truncated.
    """
    by_encoding = {image.encoding: (image, _pixels(port, image)) for port, image in images.items()}
    if len(by_encoding) != len(_CHANNELS):
        encodings = ", ".join(f"{port!r} is {image.encoding}" for port, image in images.items())
        raise RunError(f"perception needs one image of rgb8 and one of 32FC1 (depth); {encodings}")
    (color, rgb), (deep, depth) = by_encoding["rgb8"], by_encoding["32FC1"]
    one, two = ((i.width, i.height, i.focal, i.centre) for i in (color, deep))
    if one != two:
        raise RunError(
            "the images come from different cameras: width, height, focal, centre are "
            f"{one} in colour and {two} in depth"
        )
    depth = depth[:, :, 0].astype(np.float64)
    return View(rgb=rgb, depth=depth, focal=color.focal, centre=color.centre)


def _pixels(port: str, image: Image) -> NDArray[Any]:
    dtype, channels = _CHANNELS[image.encoding]
    size = image.width * image.height * channels * np.dtype(dtype).itemsize
    if len(image.data) != size or size == 0:
        raise RunError(
            f"input {port!r}: {image.width} x {image.height} pixels of {image.encoding} need "
            f"{size} bytes, received {len(image.data)}"
        )
    return np.frombuffer(image.data, dtype).reshape(image.height, image.width, channels)
