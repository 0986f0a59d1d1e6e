"""Cameras: pinholes, behind a lens that blurs and a sensor with noise of colour and depth."""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepbus_participant import format_duration
from stepbus_plant.engine import Engine, Light, Link
from stepbus_plant.geometry import Array, projection_matrix, rotation
from stepbus_plant.memory import Remembers
from stepbus_plant.noise import Noise
from stepbus_plant.params import CameraErrors
from stepbus_plant.world import CameraSettings
from stepbus_schemas import Description, Image, Message, PointCloud

# Matt surfaces under light from above: each colour is 0.6 to 1.0 times that of its visual.
_EVEN = Light(
    direction=(0.3, 0.2, 1.0),
    distance=2.0,
    ambient=0.6,
    diffuse=0.4,
    specular=0.0,
    has_shadow=False,
)
_LAMP = Light(
    direction=(0.0, 0.0, 1.0),
    distance=3.0,
    ambient=0.45,
    diffuse=0.5,
    specular=0.1,
    has_shadow=True,
)
_TILT = (0.3, 0.7)
"""Between the lamp's direction and the vertical [rad]."""


class Lens:
    """Light, blur and noise of all cameras of a plant; seed: of the plant."""

    def __init__(self, errors: CameraErrors, seed: int) -> None:
        self._errors, self._seed = errors, seed
        self.light = _EVEN if errors.light == "even" else self._lamp()
        reach = math.ceil(3 * errors.blur)
        weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (errors.blur or 1.0)) ** 2)
        self._weights = (weights / weights.sum()).astype(np.float32)

    def _lamp(self) -> Light:
        tilt, turn = Noise(self._seed, "lamp").at(0).random(2).tolist()
        sideways = math.tan(_TILT[0] + tilt * (_TILT[1] - _TILT[0]))
        turn = 2 * math.pi * turn
        direction = (sideways * math.cos(turn), sideways * math.sin(turn), 1.0)
        return replace(_LAMP, direction=direction)

    def colors(self, pixels: NDArray[np.uint8], camera: str, t_ns: int) -> NDArray[np.uint8]:
        """Return what a camera makes of colours, shape (h, w, 3), at a time [ns]."""
        errors = self._errors
        if not errors.blur and not errors.color:
            return pixels
        seen = pixels.astype(np.float32)
        if errors.blur:
            # Down, and then across: each time along the first axis.
            seen = self._blurred(self._blurred(seen).swapaxes(0, 1)).swapaxes(0, 1)
        if errors.color:
            draws = Noise(self._seed, "color", camera).at(t_ns)
            noise = draws.standard_normal(pixels.shape, dtype=np.float32)
            seen += np.float32(errors.color) * noise
        return np.clip(np.rint(seen), 0, 255).astype(np.uint8)

    def depth(self, metres: NDArray[np.float32], camera: str, t_ns: int) -> NDArray[np.float32]:
        """Return what a camera makes of depth, shape (h, w) [m]; of nothing it makes nothing."""
        errors = self._errors
        if not (errors.depth or errors.depth_floor or errors.depth_bias):
            return metres
        draws = Noise(self._seed, "depth", camera).at(t_ns)
        noise = draws.standard_normal(metres.shape, dtype=np.float32)
        offset = errors.depth_bias * Noise(self._seed, "depth bias", camera).at(0).normal()
        known = np.isfinite(metres)
        near = np.where(known, metres, 0.0)
        spread = np.float32(errors.depth_floor) + np.float32(errors.depth) * near**2
        noisy = near + spread * noise + np.float32(offset)
        return np.where(known, noisy, np.inf).astype("<f4")

    def _blurred(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return weighted sums of neighbours along the first axis; beyond the rim it goes on."""
        reach, count = len(self._weights) // 2, len(pixels)
        padded = pixels[np.clip(np.arange(-reach, count + reach), 0, count - 1)]
        part: NDArray[np.float32] = self._weights[0] * padded[:count]
        total = part.copy()
        for n, weight in enumerate(self._weights[1:], 1):
            np.multiply(weight, padded[n : n + count], out=part)
            total += part
        return total


IMAGE, CLOUD = "Image/1", "PointCloud/1"
TYPES = {"rgb": IMAGE, "depth": IMAGE, "points": CLOUD}
"""Camera port → its message type."""

Rendering = tuple[Image, Image]
"""Colours and depth."""


class Camera(Remembers):
    """A pinhole RGB-D camera without lens distortion.

    Its link is the optical frame: z forward, x right, y down. Integer pixel coordinates are pixel
    centres, counted from 0, so the principal point is ((width - 1) / 2, (height - 1) / 2).
    is_on: whether it takes images; is_disabled: it takes none in the whole run. period_ns: between
    two of them [ns]; None: each step. latency_ns: after which they are put out [ns].
    """

    remembers = ("is_on", "_is_asked")

    def __init__(
        self, name: str, row: CameraSettings, link: Link, engine: Engine, lens: Lens
    ) -> None:
        self.name = name
        self.row = row
        self.is_on, self.is_disabled = True, False
        self.period_ns = row.period_ns
        self.latency_ns = row.latency_ns or 0
        self._is_triggered = self._is_asked = False
        self._link, self._engine, self._lens = link, engine, lens
        self._focal = row.height / 2 / math.tan(row.fov / 2)
        self._projection = projection_matrix(row.fov, row.width / row.height, row.near, row.far)
        self._asked_ns = -1
        self._under_way: deque[tuple[int, Rendering]] = deque()
        self._shown: Rendering | None = None

    def _view(self) -> Array:
        """Return the transform from the world to OpenGL's camera frame, shape (4, 4)."""
        position, orientation = self._engine.frame(self._link)
        # OpenGL's camera looks along -z, with y up.
        to_world = rotation(orientation) * (1.0, -1.0, -1.0)
        matrix = np.eye(4)
        matrix[:3, :3] = to_world.T
        matrix[:3, 3] = -to_world.T @ position
        return matrix

    def wait_for_triggers(self) -> None:
        """Take images on request from now on, instead of periodically."""
        self._is_triggered, self.period_ns = True, None

    def trigger(self) -> None:
        """Ask for one image, at the next step."""
        self._is_asked = True

    @property
    def is_busy(self) -> bool:
        """Return whether it has images under way, which are not saved."""
        return bool(self._under_way)

    def images(self, t_ns: int) -> Rendering | None:
        """Return the images due at a time [ns], drawn once for all ports; None: no image is due.

        An image shows the world at the time of its exposure, `latency_ns` earlier.
        """
        if t_ns != self._asked_ns:
            self._asked_ns = t_ns
            is_asked, self._is_asked = self._is_asked, False
            is_due = is_asked if self._is_triggered else t_ns % (self.period_ns or 1) == 0
            if is_due and self.is_on and not self.is_disabled:
                self._under_way.append((t_ns + self.latency_ns, self.render(t_ns)))
            is_due = bool(self._under_way) and self._under_way[0][0] == t_ns
            self._shown = self._under_way.popleft()[1] if is_due else None
        return self._shown

    def render(self, t_ns: int = 0) -> Rendering:
        """Return the current colour image, and the depth along z [m]; t_ns: of its noise.

        Depth is +inf where there is nothing between `near` and `far` (REP 117 and 118 of ROS).
        """
        row = self.row
        colours, buffer = self._engine.image(
            (row.width, row.height), self._view(), self._projection, self._lens.light
        )
        # OpenGL's depth buffer is 0 at `near` and 1 at `far`.
        metres = row.far * row.near / (row.far - (row.far - row.near) * buffer)
        depth = np.where(buffer < 1.0, metres, np.inf).astype("<f4")
        return (
            self._image("rgb8", self._lens.colors(colours, self.name, t_ns).tobytes()),
            self._image("32FC1", self._lens.depth(depth, self.name, t_ns).tobytes()),
        )

    def cloud(self, rendering: Rendering) -> PointCloud:
        """Return the points of pixels with a depth, row by row, in the frame of the link."""
        row, every = self.row, slice(None, None, self.row.stride)
        colours = np.frombuffer(rendering[0].data, np.uint8).reshape(row.height, row.width, 3)
        depth = np.frombuffer(rendering[1].data, "<f4").reshape(row.height, row.width)
        rows, columns = range(0, row.height, row.stride), range(0, row.width, row.stride)
        v, u = np.meshgrid(rows, columns, indexing="ij")
        z = depth[every, every].astype(np.float64)
        seen = np.isfinite(z)
        x = (u - (row.width - 1) / 2) * z / self._focal
        y = (v - (row.height - 1) / 2) * z / self._focal
        points = np.stack([x[seen], y[seen], z[seen]], axis=1).astype("<f4")
        return PointCloud(
            count=len(points),
            points=points.tobytes(),
            colours=np.ascontiguousarray(colours[every, every][seen]).tobytes(),
        )

    def _image(self, encoding: Literal["rgb8", "32FC1"], pixels: bytes) -> Image:
        return Image(
            width=self.row.width,
            height=self.row.height,
            encoding=encoding,
            data=pixels,
            focal=(self._focal, self._focal),
            centre=((self.row.width - 1) / 2, (self.row.height - 1) / 2),
        )


class View:
    """What one port shows of a camera: a quantity of `TYPES`."""

    def __init__(self, camera: Camera, quantity: str) -> None:
        self.camera, self.port_type = camera, TYPES[quantity]
        self._quantity = quantity

    @property
    def description(self) -> Description:
        """Return camera and shape; with a latency, and a period unless it waits for requests."""
        camera, row = self.camera, self.camera.row
        size = [row.height, row.width]
        shapes = {
            "rgb": [*size, 3],
            "depth": [*size, 1],
            "points": [math.prod(-(-n // row.stride) for n in size), 3],
        }
        details = {"link": [row.link]}
        if camera.period_ns is not None:
            details["period"] = [format_duration(camera.period_ns)]
        if camera.latency_ns:
            details["latency"] = [format_duration(camera.latency_ns)]
        return Description(names=[camera.name], shape=shapes[self._quantity], details=details)

    def sense(self, t_ns: int) -> Message | None:
        """Return what the camera puts out at a time [ns]; None: nothing."""
        images = self.camera.images(t_ns)
        if images is None or self._quantity == "points":
            return None if images is None else self.camera.cloud(images)
        return images[0] if self._quantity == "rgb" else images[1]


def views(cameras: Mapping[str, Camera]) -> dict[str, View]:
    """Return name of a port → what it shows."""
    named: dict[str, View] = {}
    for quantity in TYPES:
        for name, camera in cameras.items():
            view = View(camera, quantity)
            named |= {quantity: view} if len(cameras) == 1 else {}
            named[f"{name}_{quantity}"] = view
    return named
