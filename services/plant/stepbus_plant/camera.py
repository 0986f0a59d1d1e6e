"""What a real camera makes of a scene: a lamp, blur, and noise of colour and depth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from stepbus_participant import format_duration, suggest
from stepbus_participant.parameters import Keys
from stepbus_plant.params import CameraErrors
from stepbus_plant.poses import PoseSensor, link_indices
from stepbus_plant.readings import Noise
from stepbus_plant.world import CameraSettings
from stepbus_plant.world_file import World
from stepbus_schemas import Description, Image, Message, PointCloud, WiringError

_WHITE = (1.0, 1.0, 1.0)
# Matt surfaces under white light from above: each colour is 0.6 to 1.0 times that of its visual.
_EVEN = {
    "shadow": 0,
    "lightDirection": (0.3, 0.2, 1.0),
    "lightColor": _WHITE,
    "lightDistance": 2.0,
    "lightAmbientCoeff": 0.6,
    "lightDiffuseCoeff": 0.4,
    "lightSpecularCoeff": 0.0,
}
_LAMP = {
    "shadow": 1,
    "lightColor": _WHITE,
    "lightDistance": 3.0,
    "lightAmbientCoeff": 0.45,
    "lightDiffuseCoeff": 0.5,
    "lightSpecularCoeff": 0.1,
}
_TILT = (0.3, 0.7)
"""Between the lamp's direction and the vertical [rad]."""


class Lens:
    """Light, blur and noise of all cameras of a plant; seed: of the plant."""

    def __init__(self, errors: CameraErrors, seed: int) -> None:
        self._errors, self._seed = errors, seed
        self.light: Mapping[str, Any] = _EVEN if errors.light == "even" else self._lamp()
        reach = math.ceil(3 * errors.blur)
        weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (errors.blur or 1.0)) ** 2)
        self._weights = (weights / weights.sum()).astype(np.float32)

    def _lamp(self) -> Mapping[str, Any]:
        tilt, turn = Noise(self._seed, "lamp").at(0).random(2).tolist()
        tilt, turn = _TILT[0] + tilt * (_TILT[1] - _TILT[0]), 2 * math.pi * turn
        sideways = math.tan(tilt)
        direction = (sideways * math.cos(turn), sideways * math.sin(turn), 1.0)
        return {**_LAMP, "lightDirection": direction}

    def colors(self, pixels: NDArray[np.uint8], camera: str, t_ns: int) -> NDArray[np.uint8]:
        """Return what a camera makes of colours, shape (h, w, 3), at a time [ns]."""
        errors = self._errors
        if not errors.blur and not errors.color:
            return pixels
        seen = pixels.astype(np.float32)
        seen = self._blurred(seen) if errors.blur else seen
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
        height, width, channels = pixels.shape
        down = self._weighted(pixels.reshape(height, width * channels))
        # Neighbours in a row are as many values apart as a pixel has.
        across = self._weighted(down.reshape(height, width, channels).swapaxes(0, 1))
        return across.swapaxes(0, 1)

    def _weighted(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return weighted sums of neighbours along the first axis; beyond the rim it goes on."""
        reach, count = len(self._weights) // 2, len(pixels)
        rows = np.clip(np.arange(-reach, count + reach), 0, count - 1)
        padded = pixels[rows]
        part: NDArray[np.float32] = self._weights[0] * padded[:count]
        total = part.copy()
        for n, weight in enumerate(self._weights[1:], 1):
            np.multiply(weight, padded[n : n + count], out=part)
            total += part
        return total


IMAGE, CLOUD = "Image/1", "PointCloud/1"
TYPES = {"rgb": IMAGE, "depth": IMAGE, "points": CLOUD}
"""What a port shows of a camera → its message type."""

Quantity = Literal["rgb", "depth", "points"]
Rendering = tuple[Image, Image]
"""Colours and depth."""


class Camera:
    """A pinhole RGB-D camera without lens distortion.

    Its link is the optical frame: z forward, x right, y down. Integer pixel coordinates are pixel
    centres, counted from 0, so the principal point is ((width - 1) / 2, (height - 1) / 2).
    """

    def __init__(
        self,
        name: str,
        row: CameraSettings,
        client: int,
        bodies: Sequence[str],
        lens: Lens | None = None,
    ) -> None:
        self.row = row
        self._name, self._lens = name, lens or Lens(CameraErrors(), 0)
        self.period_ns = row.period_ns
        self._client = client
        self._pose = PoseSensor(client, bodies, [row.link])
        self._focal = row.height / 2 / math.tan(row.fov / 2)
        self._projection = self._column_major(self._project())

    def _project(self) -> np.ndarray:
        """Return OpenGL's projection matrix, shape (4, 4)."""
        row, matrix = self.row, np.zeros((4, 4))
        matrix[0, 0] = 2 * self._focal / row.width
        matrix[1, 1] = 2 * self._focal / row.height
        # The renderer samples the corner of a pixel; shift by half a pixel to its centre.
        matrix[0, 2], matrix[1, 2] = 1 / row.width, 1 / row.height
        matrix[2, 2] = (row.far + row.near) / (row.near - row.far)
        matrix[2, 3] = 2 * row.far * row.near / (row.near - row.far)
        matrix[3, 2] = -1.0
        return matrix

    def _view(self) -> np.ndarray:
        """Return the transform from the world to OpenGL's camera frame, shape (4, 4)."""
        pose = self._pose.sense()
        rotation = np.reshape(bullet.getMatrixFromQuaternion(pose.orientation[0]), (3, 3))
        # OpenGL's camera looks along -z, with y up.
        rotation = rotation * (1.0, -1.0, -1.0)
        matrix = np.eye(4)
        matrix[:3, :3] = rotation.T
        matrix[:3, 3] = -rotation.T @ pose.position[0]
        return matrix

    @staticmethod
    def _column_major(matrix: np.ndarray) -> list[float]:
        values: list[float] = matrix.T.ravel().tolist()
        return values

    def render(self, t_ns: int = 0) -> Rendering:
        """Return the current colour image, and the depth along z [m]; t_ns: of its noise.

        Depth is +inf where there is nothing between `near` and `far` (REP 117 and 118 of ROS).
        """
        row = self.row
        _, _, rgba, buffer, _ = bullet.getCameraImage(
            row.width,
            row.height,
            viewMatrix=self._column_major(self._view()),
            projectionMatrix=self._projection,
            renderer=bullet.ER_TINY_RENDERER,
            flags=bullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=self._client,
            **self._lens.light,
        )
        colours = np.reshape(np.asarray(rgba, dtype=np.uint8), (row.height, row.width, 4))[..., :3]
        colours = self._lens.colors(colours, self._name, t_ns)
        depth = self._lens.depth(self._depth(buffer), self._name, t_ns)
        return self._image("rgb8", colours), self._image("32FC1", depth)

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

    def _depth(self, buffer: Any) -> np.ndarray:
        """Return metres from OpenGL's depth buffer, which is 0 at `near` and 1 at `far`."""
        near, far = self.row.near, self.row.far
        depth = np.asarray(buffer, dtype=np.float64)
        metres = far * near / (far - (far - near) * depth)
        return np.where(depth < 1.0, metres, np.inf).astype("<f4")

    def _image(self, encoding: Literal["rgb8", "32FC1"], pixels: np.ndarray) -> Image:
        return Image(
            width=self.row.width,
            height=self.row.height,
            encoding=encoding,
            data=pixels.tobytes(),
            focal=(self._focal, self._focal),
            centre=((self.row.width - 1) / 2, (self.row.height - 1) / 2),
        )


class _View(NamedTuple):
    """The image of one port."""

    camera: str
    quantity: Quantity


class Cameras:
    """All cameras that a world file declares; each is on or off.

    bodies: names of the engine's bodies, in its order. period_ns: length of the plant's step [ns].
    lens: what they make of the scene. enabled: false keeps all cameras off.
    Raises WiringError that lists every mistake, each with its line.
    """

    def __init__(
        self,
        world: World,
        client: int,
        bodies: Sequence[str],
        period_ns: int,
        lens: Lens,
        *,
        enabled: bool,
    ) -> None:
        links = link_indices(client, bodies) if world.cameras else {}
        world.source.refuse(
            [
                problem
                for name, row in world.cameras.items()
                for problem in _problems(name, row, links, period_ns)
            ]
        )
        self._cameras = {
            name: Camera(name, row, client, bodies, lens) for name, row in world.cameras.items()
        }
        self._on = dict.fromkeys(self._cameras, enabled)
        self._enabled = enabled

    @property
    def names(self) -> list[str]:
        """Return the names of all cameras, in the order of the world."""
        return list(self._cameras)

    def switch(self, name: str, *, on: bool) -> None:
        """Switch a camera on or off; it stays off if cameras are disabled."""
        self._on[name] = on and self._enabled

    def views(self, ports: Mapping[str, str]) -> Views:
        """Return the images of ports; a port's name selects camera and quantity.

        ports: name → message type. Raises WiringError that lists the ports with unknown names.
        """
        known: dict[str, _View] = {}
        for quantity in get_args(Quantity):
            if len(self._cameras) == 1:
                known[quantity] = _View(self.names[0], quantity)
            known |= {f"{name}_{quantity}": _View(name, quantity) for name in self._cameras}
        mistakes = []
        for port, port_type in ports.items():
            fitting = [name for name, view in known.items() if TYPES[view.quantity] == port_type]
            if port not in fitting:
                text = (
                    f"name it one of {', '.join(fitting)}"
                    if known
                    else "the world has no 'cameras'"
                )
                mistakes.append(f"{port}: has type {port_type}; {text}")
        if mistakes:
            raise WiringError("\n".join(mistakes))
        return Views(self, {port: known[port] for port in ports})

    def due(self, name: str, t_ns: int) -> bool:
        """Return whether a camera takes an image at a time [ns]."""
        return self._on[name] and t_ns % self._cameras[name].period_ns == 0

    def camera(self, name: str) -> Camera:
        """Return a camera by its name."""
        return self._cameras[name]


class Views:
    """The images of several ports; each camera is rendered once for all of them."""

    def __init__(self, cameras: Cameras, views: Mapping[str, _View]) -> None:
        self._cameras = cameras
        self._views = views
        self._names = list(dict.fromkeys(view.camera for view in views.values()))

    def describe(self) -> dict[str, Description]:
        """Return for each port the camera, its link, its period and the shape of the image."""
        return {port: self._description(view) for port, view in self._views.items()}

    def _description(self, view: _View) -> Description:
        camera = self._cameras.camera(view.camera)
        row = camera.row
        return Description(
            names=[view.camera],
            shape=_shape(row, view.quantity),
            details={"link": [row.link], "period": [format_duration(camera.period_ns)]},
        )

    def images(self, t_ns: int) -> dict[str, Message]:
        """Return the image of each port whose camera is due at a time [ns]."""
        due = [name for name in self._names if self._cameras.due(name, t_ns)]
        rendered = {name: self._cameras.camera(name).render(t_ns) for name in due}
        return {
            port: self._message(view, rendered[view.camera])
            for port, view in self._views.items()
            if view.camera in rendered
        }

    def _message(self, view: _View, rendering: Rendering) -> Message:
        match view.quantity:
            case "rgb":
                return rendering[0]
            case "depth":
                return rendering[1]
            case _:
                return self._cameras.camera(view.camera).cloud(rendering)


def _shape(row: CameraSettings, quantity: Quantity) -> list[int]:
    """Return the shape of an image; of a cloud, its largest one."""
    if quantity == "points":
        rows, columns = (-(-size // row.stride) for size in (row.height, row.width))
        return [rows * columns, 3]
    return [row.height, row.width, 3 if quantity == "rgb" else 1]


def _problems(
    name: str, row: CameraSettings, links: Iterable[str], period_ns: int
) -> Iterable[tuple[Keys, str]]:
    """Yield the mistakes about a camera; period_ns: length of the plant's step [ns]."""
    if row.link not in links:
        yield (
            ("cameras", name, "link"),
            f"link {row.link!r} is unknown{suggest(row.link, links)}",
        )
    if row.period_ns % period_ns:
        period, step = format_duration(row.period_ns), format_duration(period_ns)
        text = f"{period} is not a multiple of the plant's step ({step})"
        yield ("cameras", name, "period"), text
