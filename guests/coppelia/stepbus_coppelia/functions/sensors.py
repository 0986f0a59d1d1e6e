"""Sensors: vision, proximity, collisions and distances."""

import struct
from typing import TYPE_CHECKING, Any

import numpy as np

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.proximity import Reading, reading
from stepbus_coppelia.scene import SHAPE, SceneObject

from .table import CONSTANTS, function, number

if TYPE_CHECKING:
    from stepbus_coppelia.session import Session

_GROUP = "sensors"
_NOTHING = Reading(False, 0.0, [0.0, 0.0, 0.0], -1, [0.0, 0.0, 0.0])


# --- vision --------------------------------------------------------------------------------------


def _images(sim: "Session", handle: int) -> tuple[SceneObject, Any, Any]:
    """Return a vision sensor, its colours, shape (h, w, 3), and depths [m], bottom row first."""
    thing = sim.scene.get(handle)
    if thing.camera is None:
        raise ApiError("object is not a vision sensor.")
    if thing.values.get("seen") != sim.moment:
        colours, depths = thing.camera.render()
        size = thing.camera.row.height, thing.camera.row.width
        thing.values["seen"] = sim.moment
        thing.values["colours"] = np.frombuffer(colours.data, np.uint8).reshape(*size, 3)[::-1]
        thing.values["depths"] = np.frombuffer(depths.data, "<f4").reshape(size)[::-1]
    return thing, thing.values["colours"], thing.values["depths"]


def _part(image: Any, where: Any, size: Any) -> Any:
    (x, y), (width, height) = where or (0, 0), size or (0, 0)
    rows, columns = image.shape[:2]
    return image[y : y + (height or rows), x : x + (width or columns)]


@function(_GROUP, "getVisionSensorImage")
def get_vision_sensor_img(
    sim: "Session",
    handle: int,
    options: int = 0,
    cut_off: float = 0.0,
    where: Any = None,
    size: Any = None,
) -> tuple[bytes, list[int]]:
    """Return the image as bytes from the bottom row up, and its size; options 1: grey, 2: RGBA."""
    _, colours, depths = _images(sim, handle)
    colours, depths = _part(colours, where, size), _part(depths, where, size)
    if int(options) & 1:
        colours = (colours.sum(axis=2, dtype=np.uint16) // 3).astype(np.uint8)
    elif int(options) & 2:
        near = ~np.isinf(depths) if cut_off <= 0.0 else depths < number(cut_off)
        colours = np.dstack([colours, np.where(near, 255, 0).astype(np.uint8)])
    return colours.tobytes(), get_vision_sensor_res(sim, handle)


@function(_GROUP)
def get_vision_sensor_char_image(
    sim: "Session",
    handle: int,
    x: int = 0,
    y: int = 0,
    width: int = 0,
    height: int = 0,
    *_more: Any,
) -> tuple[Any, ...]:
    """Return the image as bytes from the bottom row up, its width and its height."""
    data, size = get_vision_sensor_img(sim, handle, 0, 0.0, [x, y], [width, height])
    return data, *size


@function(_GROUP, "getVisionSensorDepthBuffer")
def get_vision_sensor_depth(
    sim: "Session", handle: int, options: int = 0, where: Any = None, size: Any = None
) -> tuple[bytes, list[int]]:
    """Return the depths as floats from the bottom row up; options 1: in metres, else 0 to 1."""
    thing, _, depths = _images(sim, handle)
    depths, row = _part(depths, where, size), thing.camera.row  # type: ignore[union-attr]
    metres = np.minimum(depths, row.far)
    if not int(options) & 1:
        metres = (metres - row.near) / (row.far - row.near)
    return metres.astype("<f4").tobytes(), get_vision_sensor_res(sim, handle)


@function(_GROUP, "getVisionSensorResolution")
def get_vision_sensor_res(sim: "Session", handle: int) -> list[int]:
    """Return width and height of the image [pixel]."""
    thing = sim.scene.get(handle)
    if thing.camera is None:
        raise ApiError("object is not a vision sensor.")
    return [thing.camera.row.width, thing.camera.row.height]


@function(_GROUP)
def read_vision_sensor(sim: "Session", handle: int) -> tuple[int, list[float], list[float]]:
    """Return 0, then least, largest and mean of intensity, red, green, blue and depth."""
    thing, colours, depths = _images(sim, handle)
    row = thing.camera.row  # type: ignore[union-attr]
    share = (np.minimum(depths, row.far) - row.near) / (row.far - row.near)
    grey = colours.mean(axis=2)
    planes = [grey / 255.0, *(colours[..., i] / 255.0 for i in range(3)), share]
    return 0, [float(f(plane)) for f in (np.min, np.max, np.mean) for plane in planes], []


@function(_GROUP, "checkVisionSensor")
def handle_vision_sensor(
    sim: "Session", handle: int, *_more: Any
) -> tuple[int, list[float], list[float]]:
    """Take a new image, and returns what `readVisionSensor` does."""
    if handle == CONSTANTS["handle_all"]:
        return 0, [], []
    sim.scene.get(handle).values.pop("seen", None)
    return read_vision_sensor(sim, handle)


# --- proximity, collisions, distances ------------------------------------------------------------


@function(_GROUP, "handleProximitySensor")
def read_proximity_sensor(sim: "Session", handle: int) -> tuple[Any, ...]:
    """Return whether it detects, the distance [m], the point in its frame, the object, the normal."""
    if handle == CONSTANTS["handle_all"]:
        return tuple(_NOTHING)
    thing = sim.scene.get(handle)
    if thing.sensor is None:
        raise ApiError("object is not a proximity sensor.")
    found = reading(sim.scene, thing) or _NOTHING
    return int(found.detects), *found[1:]


@function(_GROUP)
def check_proximity_sensor(sim: "Session", handle: int, entity: int) -> tuple[Any, ...]:
    """Return the same, if what it detects is an object, its tree or a collection."""
    found = read_proximity_sensor(sim, handle)
    wanted = _shapes(sim, entity)
    is_wanted = wanted is None or found[3] in [shape.handle for shape in wanted]
    return found if is_wanted else (0, *tuple(_NOTHING)[1:])


def _shapes(sim: "Session", entity: Any) -> list[SceneObject] | None:
    """Return the links of an object, or of a collection; None: all."""
    if entity in (None, CONSTANTS["handle_all"]):
        return None
    if entity in sim.collections:
        return sim.collections[entity]
    thing = sim.scene.get(entity)
    return (
        [thing] if thing.kind == SHAPE else [o for o in sim.scene.below(thing) if o.kind == SHAPE]
    )


def _nearest(sim: "Session", one: Any, other: Any, within: float) -> Any:
    """Return the nearest contact of two entities within a distance [m]; None: there is none."""
    first, second = _shapes(sim, one), _shapes(sim, other)
    links = None if second is None else [shape.link for shape in second]
    rows = [
        contact
        for shape in (first or [o for o in sim.scene.objects.values() if o.kind == SHAPE])
        if shape.link is not None
        for contact in sim.scene.engine.closest(shape.link, within)
        if links is None or contact.other in links
    ]
    return min(rows, key=lambda contact: contact.distance, default=None)


@function(_GROUP)
def check_collision(sim: "Session", one: int, other: int = -2) -> tuple[int, list[int]]:
    """Return whether two objects of different bodies collide, and the handles of both."""
    found = _nearest(sim, one, other, 1e-3)
    if found is None or found.distance > 0.0:
        return 0, [-1, -1]
    return 1, [sim.scene.of(found.one).handle, sim.scene.of(found.other).handle]


@function(_GROUP)
def check_distance(
    sim: "Session", one: int, other: int = -2, threshold: float = 0.0
) -> tuple[int, list[float], list[int]]:
    """Return whether they are nearer than a threshold, both points and their distance [m]."""
    found = _nearest(sim, one, other, number(threshold) if threshold > 0.0 else 10.0)
    if found is None:
        return 0, [0.0] * 7, [-1, -1]
    pair = [sim.scene.of(found.one).handle, sim.scene.of(found.other).handle]
    return 1, [*found.on_one, *found.on_other, found.distance], pair


# --- collections ---------------------------------------------------------------------------------


@function(_GROUP)
def create_collection(sim: "Session", *_options: Any) -> int:
    """Make an empty collection of objects."""
    handle = 2_000_000 + len(sim.collections)
    sim.collections[handle] = []
    return handle


@function(_GROUP)
def add_item_to_collection(
    sim: "Session", collection: int, what: int, handle: int, _options: int = 0
) -> None:
    """Add an object (`handle_single`), its tree (`handle_tree`) or all (`handle_all`)."""
    if collection not in sim.collections:
        raise ApiError("collection does not exist.")
    found = [] if handle == -1 else [sim.scene.get(handle)]
    if what == CONSTANTS["handle_tree"]:
        found += list(sim.scene.below(found[0]))
    elif what == CONSTANTS["handle_all"]:
        found = list(sim.scene.objects.values())
    sim.collections[collection] += [thing for thing in found if thing.kind == SHAPE]


@function(_GROUP)
def destroy_collection(sim: "Session", collection: int) -> None:
    """Forget a collection."""
    if sim.collections.pop(collection, None) is None:
        raise ApiError("collection does not exist.")


# --- buffers -------------------------------------------------------------------------------------


@function("buffers")
def transform_buffer(
    _sim: "Session", data: bytes, kind: int, scale: float, offset: float, result: int
) -> bytes:
    """Return a buffer with each number scaled, and of another kind."""
    kinds = {0: "B", 1: "b", 4: "f", 5: "d"}
    if kind not in kinds or result not in kinds:
        raise ApiError("this kind of buffer is not available in stepbus.")
    values = np.frombuffer(data, kinds[kind]).astype(float) * scale + offset
    return values.astype(kinds[result]).tobytes()


_FORMATS = {"UInt8": "B", "UInt16": "H", "UInt32": "I", "Int32": "i", "Float": "f", "Double": "d"}


def _add_buffers() -> None:
    """Add `packFloatTable`, `unpackFloatTable` and the like."""

    def pack_of(form: str) -> Any:
        def pack(_sim: "Session", values: Any, start: int = 0, count: int = 0) -> bytes:
            rows = values[start : start + count] if count else values[start:]
            return struct.pack(f"<{len(rows)}{form}", *rows)

        return pack

    def unpack_of(form: str) -> Any:
        def unpack(
            _sim: "Session", data: bytes, start: int = 0, count: int = 0, offset: int = 0
        ) -> list[Any]:
            size = struct.calcsize(form)
            rest = data[offset + start * size :]
            count = count or len(rest) // size
            return list(struct.unpack(f"<{count}{form}", rest[: count * size]))

        return unpack

    for name, form in _FORMATS.items():
        for work, verb, text in (
            (pack_of(form), "pack", "Returns numbers as a buffer."),
            (unpack_of(form), "unpack", "Returns the numbers of a buffer."),
        ):
            work.__name__, work.__doc__ = f"{verb}{name}Table", text
            function("buffers")(work)


_add_buffers()
