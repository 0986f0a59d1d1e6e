"""Sensors: vision, proximity, collisions and distances."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.proximity import reading
from stepbus_coppelia.scene import SHAPE, SceneObject
from stepbus_participant import suggest
from stepbus_plant.engine import Link

from .table import CONSTANTS, Group, number

_ALL = CONSTANTS["handle_all"]
_NOTHING = (0, 0.0, [0.0, 0.0, 0.0], -1, [0.0, 0.0, 0.0])
_GIVEN = (-1, -1)
"""Moment of an image that a script has given."""
_COLLISIONS = 3_000_000
"""Handle of the first collision object."""


class Sensors(Group):
    """What sensors detect, and which objects touch."""

    title = "sensors"
    also = {
        "getVisionSensorResolution": "getVisionSensorRes",
        "setVisionSensorImage": "setVisionSensorImg",
        "setVisionSensorCharImage": "setVisionSensorImg",
        "checkVisionSensor": "handleVisionSensor",
        "handleProximitySensor": "readProximitySensor",
    }

    def _images(self, handle: int) -> tuple[Any, Any, Any]:
        """Return settings, colours, shape (h, w, 3), and depths [m], bottom row first."""
        thing = self.sim.scene.get(handle)
        if thing.camera is None:
            raise ApiError("object is not a vision sensor.")
        now = self.sim.runs, self.sim.step
        if thing.values.get("seen") not in (now, _GIVEN):
            size = thing.camera.row.height, thing.camera.row.width
            colours, depths = thing.camera.render()
            thing.values["seen"] = now
            thing.values["images"] = (
                np.frombuffer(colours.data, np.uint8).reshape(*size, 3)[::-1],
                np.frombuffer(depths.data, "<f4").reshape(size)[::-1],
            )
        return thing.camera.row, *thing.values["images"]

    def getVisionSensorImg(
        self, handle: int, options: int = 0, cut: float = 0.0, at: Any = None, size: Any = None
    ) -> tuple[bytes, list[int]]:
        """Return the image as bytes from the bottom row up, and its size; 1: grey, 2: RGBA."""
        _, colours, depths = self._images(handle)
        colours, depths = _part(colours, at, size), _part(depths, at, size)
        if int(options) & 1:
            colours = (colours.sum(axis=2, dtype=np.uint16) // 3).astype(np.uint8)
        elif int(options) & 2:
            near = ~np.isinf(depths) if cut <= 0.0 else depths < number(cut)
            colours = np.dstack([colours, np.where(near, 255, 0).astype(np.uint8)])
        return colours.tobytes(), self.getVisionSensorRes(handle)

    def getVisionSensorCharImage(
        self, handle: int, x: int = 0, y: int = 0, width: int = 0, height: int = 0, *_more: Any
    ) -> tuple[Any, ...]:
        """Return the image as bytes from the bottom row up, its width and its height."""
        data, size = self.getVisionSensorImg(handle, 0, 0.0, [x, y], [width, height])
        return data, *size

    def setVisionSensorImg(self, handle: int, image: bytes, options: int = 0, *_more: Any) -> int:
        """Let a sensor show an image of the script's from now on, bottom row first; 1: grey."""
        _, colours, depths = self._images(handle)
        shape = (*colours.shape[:2], 1 if int(options) & 1 else 3)
        given = np.frombuffer(image, np.uint8).reshape(shape)
        images = np.broadcast_to(given, colours.shape), depths
        self.sim.scene.get(handle).values |= {"seen": _GIVEN, "images": images}
        return 1

    def getVisionSensorDepth(
        self, handle: int, options: int = 0, at: Any = None, size: Any = None
    ) -> tuple[bytes, list[int]]:
        """Return the depths as floats from the bottom row up; options 1: [m], else 0 to 1."""
        row, _, depths = self._images(handle)
        metres = np.minimum(_part(depths, at, size), row.far)
        shown = metres if int(options) & 1 else (metres - row.near) / (row.far - row.near)
        return shown.astype("<f4").tobytes(), self.getVisionSensorRes(handle)

    def getVisionSensorRes(self, handle: int) -> list[int]:
        """Return width and height of the image [pixel]."""
        if (camera := self.sim.scene.get(handle).camera) is None:
            raise ApiError("object is not a vision sensor.")
        return [camera.row.width, camera.row.height]

    def readVisionSensor(self, handle: int) -> tuple[int, list[float], list[float]]:
        """Return 0, then least, largest and mean of intensity, red, green, blue and depth."""
        row, colours, depths = self._images(handle)
        share = (np.minimum(depths, row.far) - row.near) / (row.far - row.near)
        planes = [colours.mean(axis=2) / 255.0, *(colours[..., i] / 255.0 for i in range(3)), share]
        return 0, [float(f(plane)) for f in (np.min, np.max, np.mean) for plane in planes], []

    def handleVisionSensor(self, handle: int, *_more: Any) -> tuple[int, list[float], list[float]]:
        """Take a new image, and return what `readVisionSensor` does."""
        if handle == _ALL:
            return 0, [], []
        self.sim.scene.get(handle).values.pop("seen", None)
        return self.readVisionSensor(handle)

    def readProximitySensor(self, handle: int) -> tuple[Any, ...]:
        """Return whether it detects, distance [m], point in its frame, object, normal."""
        if handle == _ALL:
            return _NOTHING
        thing = self.sim.scene.get(handle)
        if thing.sensor is None:
            raise ApiError("object is not a proximity sensor.")
        return reading(self.sim.scene, thing) or _NOTHING

    def checkProximitySensor(self, handle: int, entity: int = _ALL) -> tuple[Any, ...]:
        """Return the same, if what it detects is an object, in its tree or in a collection."""
        found, links = self.readProximitySensor(handle), self._links(entity)
        fits = entity == _ALL or found[3] in [self.sim.scene.of(link).handle for link in links]
        return found if fits else _NOTHING

    def checkCollision(self, one: int, other: int = _ALL) -> tuple[int, list[int]]:
        """Return whether two objects of different bodies collide, and the handles of both."""
        return self._collide(self._links(one), self._links(other))

    def getCollisionHandle(self, name: str) -> int:
        """Return the handle of a collision object, which `collisions` of the gateway names."""
        try:
            self._pair(name)
        except ApiError as exc:
            # A client of the legacy API gets no text.
            self.sim.logged.append(("warning", f"collision object {name!r}: {exc}"))
            raise
        return _COLLISIONS + list(self.sim.params.collisions).index(name)

    def readCollision(self, handle: int) -> int:
        """Return 1 if the two objects of a collision object collide, otherwise 0."""
        names = dict(enumerate(self.sim.params.collisions, _COLLISIONS))
        return self._collide(*self._pair(names.get(handle, "")))[0]

    def _pair(self, name: str) -> tuple[list[Link], list[Link]]:
        """Return the links of both objects of a collision object; raises ApiError."""
        known = self.sim.params.collisions
        if name not in known:
            hint = "name its two objects under `collisions` of the gateway"
            raise ApiError(f"object does not exist; {hint}{suggest(name, known)}")
        one, other = map(self._whole, known[name])
        if len({link[0] for link in (*one, *other)}) < 2:
            raise ApiError("its objects are not of two bodies, which alone collide.")
        return one, other

    def _whole(self, path: str) -> list[Link]:
        """Return the links of an object by its path: of a robot all."""
        scene = self.sim.scene
        if (thing := scene.objects.get(scene.find(path))) is None:
            known = suggest(path, map(scene.path, scene.objects.values()))
            raise ApiError(f"{path!r} does not exist{known}")
        if thing.is_root and thing.link is not None:
            return list(scene.engine.links(thing.link[0]).values())
        return self._links(thing.handle)

    def _collide(self, first: list[Link], second: list[Link]) -> tuple[int, list[int]]:
        near = [row for link in first for row in self.sim.scene.engine.closest(link, 1e-3)]
        rows = [row for row in near if row.other in second]
        found = min(rows, key=lambda contact: contact.distance, default=None)
        if found is None or found.distance > 0.0:
            return 0, [-1, -1]
        return 1, [self.sim.scene.of(link).handle for link in (found.one, found.other)]

    def _links(self, entity: Any) -> list[Link]:
        """Return the links of an object, of what is below it, of a collection, or all."""
        scene = self.sim.scene
        shapes: Iterable[SceneObject] = self.sim.collections.get(entity, scene.objects.values())
        if entity not in (None, _ALL, *self.sim.collections):
            thing = scene.get(entity)
            shapes = [thing] if thing.kind == SHAPE else scene.below(thing)
        return [shape.link for shape in shapes if shape.kind == SHAPE and shape.link]

    def createCollection(self, *_options: Any) -> int:
        """Make an empty collection of objects."""
        handle = 2_000_000 + len(self.sim.collections)
        self.sim.collections[handle] = []
        return handle

    def addItemToCollection(self, group: int, what: int, handle: int, _options: int = 0) -> None:
        """Add an object (`handle_single`), its tree (`handle_tree`) or all (`handle_all`)."""
        if group not in self.sim.collections:
            raise ApiError("object does not exist.")
        found = [] if handle == -1 else [self.sim.scene.get(handle)]
        if what == CONSTANTS["handle_tree"]:
            found += list(self.sim.scene.below(found[0]))
        elif what == _ALL:
            found = list(self.sim.scene.objects.values())
        self.sim.collections[group] += [thing for thing in found if thing.kind == SHAPE]


def _part(image: Any, at: Any, size: Any) -> Any:
    (x, y), (width, height) = at or (0, 0), size or (0, 0)
    rows, columns = image.shape[:2]
    return image[y : y + (height or rows), x : x + (width or columns)]
