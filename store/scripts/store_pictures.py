"""Pictures of the store for its README, drawn from the recording of a run.

    stepbus run store --out runs/store && python store/scripts/store_pictures.py runs/store/run.mcap

Nothing is simulated again: the plant's engine, which draws what its cameras see too, draws the
world of the recording with the robot and every item where they stood at that step. The recording
has what the camera saw and what was detected. Needs `make robots`.
"""

import argparse
import math
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML

from stepbus import Event, JointState, Message, Recording, testing
from stepbus.messages import Detections, GripperState, Image, Poses
from stepbus_participant import Problems
from stepbus_plant import Params, load_world
from stepbus_plant.engine import Light
from stepbus_plant.geometry import projection_matrix, rotation, view_matrix
from stepbus_plant.physics import Physics
from stepbus_store.solids import read_solids

Picture = NDArray[np.uint8]
"""Red, green, blue, shape (h, w, 3)."""
Matrix = NDArray[np.float64]
M = TypeVar("M", bound=Message)

FOLDER = Path(__file__).parents[2] / "docs" / "pictures"
_LINE = (255, 255, 255)
_DARK = (30, 30, 30)
_NEAR, _FAR = 0.05, 40.0
LIGHT = Light(
    direction=(-2.0, 2.5, 6.0),
    distance=2.0,
    ambient=0.55,
    diffuse=0.5,
    specular=0.0,
    has_shadow=False,
)


class Look(NamedTuple):
    """Where a picture is taken from.

    target: what is in its middle [m]. distance: from there [m]. yaw: the camera looks along it,
    counter-clockwise from x, pitch: downwards [°]. fov: from top to bottom [°].
    """

    target: tuple[float, float, float]
    distance: float
    yaw: float
    pitch: float
    fov: float = 40.0


class Moments(NamedTuple):
    """Steps of the first sale."""

    start: int
    found: int
    grasp: int
    carry: int
    placed: int


class Log(Recording):
    """A recording of the store, by step."""

    def time_ns(self, step: int) -> int:
        """Return the simulation time of a step [ns]."""
        last = self["plant/joint_state"].last
        return step * (last.t_ns // last.step) if last else 0

    def at(self, topic: str, step: int, cls: type[M]) -> M:
        """Return the newest message of a topic at a step."""
        _, message = self[topic].latest(self.time_ns(step)) or (-1, None)
        return msgspec.convert(message, cls)

    def poses(self, step: int) -> Mapping[str, tuple[Any, Any]]:
        """Return link → position [m] and quaternion in the world."""
        poses = self.at("plant/poses", step, Poses)
        rows = zip(poses.position, poses.orientation, strict=True)
        return dict(zip(self["plant/poses"].names, rows, strict=True))

    def moments(self) -> Moments:
        """Return the steps of the first sale; raises LookupError for a run without one."""
        events = {s: m.text for s, m in self.messages("mission/events") if isinstance(m, Event)}
        found, lifted, placed = (
            next((step for step, text in events.items() if word in text), -1)
            for word in (": found", ": lifted", ": placed")
        )
        if placed < 0:
            raise LookupError("nothing was sold in this run")
        gripper = [(s, m) for s, m in self.messages("plant/gripper") if isinstance(m, GripperState)]
        grasp = next(step for step, state in gripper if state.holding)
        let_go = [s for s, state in gripper if lifted < s < placed and state.holding][-1]
        return Moments(0, found, grasp, (lifted + placed) // 2, let_go)


class Scene:
    """The world of a recording, to be drawn."""

    def __init__(self, log: Log, folder: Path) -> None:
        self._log = log
        for name, data in log.attachments.items():
            path = folder / name.removeprefix("files/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        scenario = YAML(typ="safe", pure=True).load(folder / "scenario.yaml")
        params = scenario["participants"]["plant"]["params"]
        params = testing.make_config(name="plant", params=params, folder=folder).read(Params)
        world = load_world(params.world, params.stock)
        robot = msgspec.structs.replace(world.bodies["robot"], visuals=True)
        world = msgspec.structs.replace(world, bodies={**world.bodies, "robot": robot})
        self._physics = Physics(world, 1_000_000, params, Problems())

    def show(self, step: int) -> None:
        """Put everything where it was at a step."""
        log, poses = self._log, self._log.poses(step)
        details = log["plant/poses"].description.details
        first = dict(
            zip(reversed(details["body"]), reversed(log["plant/poses"].names), strict=True)
        )
        for number, body in enumerate(self._physics.bodies):
            self._physics.engine.put(number, poses[first[body]])
        angles = log.at("plant/joint_state", step, JointState).position or []
        places = dict(zip(log["plant/joint_state"].names, angles, strict=True))
        width = log.at("plant/gripper", step, GripperState).width
        places |= dict.fromkeys(log["plant/gripper"].names, width / 2)
        for name, joint in self._physics.joints.items():
            self._physics.teleport(joint, places.get(name, 0.0), 0.0)

    def draw(self, look: Look, width: int, height: int) -> Picture:
        """Return what is seen, drawn in twice the size first to have smooth edges."""
        large, _ = self.render(look, 2 * width, 2 * height, LIGHT)
        return _picture(cv2.resize(large, (width, height), interpolation=cv2.INTER_AREA))

    def render(self, look: Look, width: int, height: int, light: Light) -> tuple[Picture, Matrix]:
        """Return what is seen, and how high above the floor each pixel is [m]; the sky: infinite.

        Both have the shape (height, width), colours also three channels.
        """
        yaw, pitch = math.radians(look.yaw - 90), -math.radians(look.pitch)
        view = view_matrix(look.target, look.distance, yaw, pitch)
        projection = projection_matrix(math.radians(look.fov), width / height, _NEAR, _FAR)
        colours, depth = self._physics.engine.image((width, height), view, projection, light)
        return colours.copy(), _heights(depth, np.linalg.inv(projection @ view))


def _heights(depth: Matrix, to_world: Matrix) -> Matrix:
    """Return the height of each pixel of a depth buffer, shape (h, w) [m].

    to_world: the inverse of view and projection, shape (4, 4).
    """
    height, width = depth.shape
    # The renderer samples the lower left corner of a pixel.
    right = 2 * np.arange(width) / width - 1
    up = 1 - 2 * np.arange(1, height + 1) / height
    x, y = np.meshgrid(right, up)
    z, w = (row[0] * x + row[1] * y + row[2] * (2 * depth - 1) + row[3] for row in to_world[2:])
    return np.where(depth < 1.0, z / w, np.inf)


def _picture(pixels: Any) -> Picture:
    return np.ascontiguousarray(pixels, dtype=np.uint8)


def _matrix(pose: tuple[Any, Any]) -> Matrix:
    """Return a pose as matrix, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation(pose[1])
    matrix[:3, 3] = pose[0]
    return matrix


def _box(shape: str) -> tuple[Matrix, Matrix]:
    """Return the smallest and the largest corner of upright shapes, in the frame of their link."""
    solids = read_solids(shape)
    corners = [solid.position + sign * solid.reach for solid in solids for sign in (-1, 1)]
    return np.min(corners, axis=0), np.max(corners, axis=0)


def _edges() -> Iterator[tuple[Matrix, Matrix]]:
    """Yield the edges of a cube from -1 to 1."""
    for axis in range(3):
        for a in (-1.0, 1.0):
            for b in (-1.0, 1.0):
                yield (
                    np.insert(np.array([a, b]), axis, -1.0),
                    np.insert(np.array([a, b]), axis, 1.0),
                )


def camera_view(log: Log, step: int) -> Picture:
    """Return colours with the detections drawn on, and depth next to it."""
    image = log.at("plant/rgb", step, Image)
    shown = np.frombuffer(image.data, dtype=np.uint8).reshape(image.height, image.width, 3)
    large = cv2.resize(shown, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    taken, _ = log["plant/rgb"].latest(log.time_ns(step)) or (step, None)
    poses = log.poses(taken)
    detections = log.at("perception/detections", step, Detections)
    to_camera = np.linalg.inv(_matrix(poses["camera"])) @ _matrix(poses[detections.frame])
    sizes = _sizes(log)
    items = [(n, item_type) for n, item_type in enumerate(detections.types) if item_type in sizes]
    for number, item_type in items:
        place = to_camera @ _matrix((detections.position[number], detections.orientation[number]))
        _draw_box(large, image, place, sizes[item_type])
    for number, item_type in items:
        place = to_camera @ np.array([*detections.position[number], 1.0])
        _label(large, f"{item_type} {detections.confidence[number]:.2f}", _pixel(image, place[:3]))
    return _beside(_picture(large), _depth(log.at("plant/depth", step, Image)))


def _sizes(log: Log) -> Mapping[str, Matrix]:
    """Return half the size of each type of item, shape (3,) [m]."""
    details = log["plant/poses"].description.details
    rows = zip(details["type"], details["shape"], strict=True)
    boxes = {item_type: _box(shape) for item_type, shape in rows if item_type}
    return {item_type: (upper - lower) / 2 for item_type, (lower, upper) in boxes.items()}


def _pixel(image: Image, point: Matrix) -> tuple[int, int]:
    """Return where a point in the optical frame is, in an image of four times the size."""
    flat = point[:2] / point[2] * image.focal + image.centre
    return round(float(flat[0]) * 4 + 1.5), round(float(flat[1]) * 4 + 1.5)


def _draw_box(picture: Any, image: Image, place: Matrix, half: Matrix) -> None:
    for ends in _edges():
        a, b = (_pixel(image, place[:3, :3] @ (end * half) + place[:3, 3]) for end in ends)
        cv2.line(picture, a, b, _LINE, 2, cv2.LINE_AA)


def _label(picture: Any, text: str, at: tuple[int, int]) -> None:
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.84, 2)
    x, y = at[0] - width // 2, at[1] + height // 2
    cv2.rectangle(picture, (x - 6, y - height - 6), (x + width + 6, y + 8), _DARK, -1)
    cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.84, _LINE, 2, cv2.LINE_AA)


def _depth(image: Image) -> Picture:
    """Return depth in grey: near is light, nothing is black."""
    metres = np.frombuffer(image.data, dtype="<f4").reshape(image.height, image.width)
    seen = np.isfinite(metres)
    near, far = metres[seen].min(), metres[seen].max()
    grey = np.where(seen, 255 - 215 * (metres - near) / max(far - near, 1e-6), 0)
    large = cv2.resize(grey.astype(np.uint8), None, fx=4, fy=4, interpolation=cv2.INTER_NEAREST)
    picture = _picture(np.repeat(large[..., None], 3, axis=2))
    _label(picture, f"depth {near:.2f} m (light) to {far:.2f} m", (290, 40))
    return picture


def _beside(*pictures: Picture) -> Picture:
    gap = np.full((pictures[0].shape[0], 8, 3), 255, dtype=np.uint8)
    columns = [column for picture in pictures for column in (picture, gap)]
    return _picture(np.concatenate(columns[:-1], axis=1))


def _titled(picture: Picture, text: str) -> Picture:
    _label(picture, text, (28 + 8 * len(text), 36))
    return picture


SCENE = Look((0.8, -0.6, 0.25), 4.4, -45.0, 28.0)
ABOVE = Look((0.95, -0.8, 0.0), 24.0, 90.0, 89.9, 9.2)
HAND = Look((0.0, 0.0, 0.0), 0.9, 65.0, 30.0, 36.0)
WHOLE = Look((0.0, 0.0, 0.45), 2.6, 60.0, 22.0)
LABELS = {
    "outlet": (0.15, 0.65),
    "robot at home": (-0.05, -0.38),
    "shelf a": (2.15, -0.62),
    "shelf b": (0.0, -1.72),
    "pillar": (1.62, 0.62),
}
"""What to write into the picture from above, and where on the floor [m]."""


def draw_all(log: Log, scene: Scene) -> Iterator[tuple[str, Picture]]:
    """Yield name and picture."""
    when = log.moments()
    scene.show(when.start)
    yield "store_scene", scene.draw(SCENE, 1600, 1000)
    yield "store_above", _from_above(scene)
    yield "store_camera", camera_view(log, when.found)
    scene.show(when.grasp)
    grasp = log.poses(when.grasp)["grasp"][0]
    yield "store_grasp", scene.draw(HAND._replace(target=grasp), 1280, 960)
    yield "store_sale", _beside(*_sale(log, scene, when))


def _from_above(scene: Scene) -> Picture:
    """Return the floor with x to the right and y up; names of things on it."""
    width, height = 1280, 1280
    picture = scene.draw(ABOVE, width, height)
    scale = height / 2 / (ABOVE.distance * math.tan(math.radians(ABOVE.fov / 2)))
    for text, (x, y) in LABELS.items():
        right, down = x - ABOVE.target[0], ABOVE.target[1] - y
        _label(picture, text, (round(width / 2 + scale * right), round(height / 2 + scale * down)))
    return picture


def _sale(log: Log, scene: Scene, when: Moments) -> Iterator[Picture]:
    """Yield the stations of a sale."""
    stations = {
        "inspect": (when.found, WHOLE),
        "grasp": (when.grasp, WHOLE),
        "carry": (when.carry, WHOLE._replace(yaw=-55.0)),
        "place": (when.placed, WHOLE._replace(yaw=-55.0)),
    }
    for word, (step, look) in stations.items():
        scene.show(step)
        x, y, _ = log.poses(step)["chassis"][0]
        picture = scene.draw(look._replace(target=(x + 0.25, y + 0.1, 0.45)), 660, 660)
        yield _titled(picture, f"{word}, {log.time_ns(step) * 1e-9:.1f} s")


def main() -> int:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="recording (run.mcap) of a run of the store")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder (default: docs/pictures)")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    log = Log(args.recording)
    with tempfile.TemporaryDirectory() as folder:
        for name, picture in draw_all(log, Scene(log, Path(folder))):
            path = args.out / f"{name}.png"
            cv2.imwrite(str(path), picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
            sys.stdout.write(f"{path}  {path.stat().st_size // 1024} kB\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
