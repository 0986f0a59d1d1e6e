"""Objects: how they are found, where they are, and what they are made of."""

from typing import TYPE_CHECKING, Any

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.scene import NOWHERE, SHAPE, SceneObject, composed
from stepbus_plant.geometry import Pose

from .table import (
    CONSTANTS,
    euler,
    flipped,
    function,
    matrix,
    number,
    numbers,
    of_euler,
    of_matrix,
    point,
    pose_of,
    turn_of,
)

if TYPE_CHECKING:
    from stepbus_coppelia.session import Session

_GROUP = "objects"
_WORLD, _PARENT = CONSTANTS["handle_world"], CONSTANTS["handle_parent"]
_FORMS = {"cuboid": "box", "spheroid": "sphere", "cylinder": "cylinder", "disc": "cylinder"}
_SHAPES = {CONSTANTS[f"primitiveshape_{name}"]: form for name, form in _FORMS.items()}
_STATIC, _RESPONDABLE = CONSTANTS["shapeintparam_static"], CONSTANTS["shapeintparam_respondable"]


_MISSING = "object does not exist, or alias/path ({!r}) is ill formatted{}."


# --- finding -------------------------------------------------------------------------------------


@function(_GROUP)
def get_object(sim: "Session", path: str, options: dict[str, Any] | None = None) -> int:
    """Return the handle of a path such as `/arm/joint1`, `./x`, `x[1]`."""
    options = options if isinstance(options, dict) else {}
    proxy = options.get("proxy", -1)
    start = sim.scene.objects.get(proxy) if isinstance(proxy, int) else None
    handle = sim.scene.find(str(path), start, int(options.get("index", 0)))
    if handle == -1 and not options.get("noError"):
        raise ApiError(_MISSING.format(path, sim.scene.similar(str(path))))
    return handle


@function(_GROUP)
def get_object_handle(sim: "Session", name: str, options: Any = None) -> int:
    """Return the handle of an older name such as `joint1` or `joint1#0`."""
    own = str(name).partition("@")[0]
    stem, _, number_ = own.partition("#")
    index = int(number_) + 1 if number_.isdecimal() else 0
    is_silent = "@silentError" in str(name) or (
        isinstance(options, dict) and options.get("noError")
    )
    path = own if own.startswith(("/", ".")) else f"/{stem}"
    handle = sim.scene.find(path, None, index)
    if handle == -1 and not is_silent:
        raise ApiError(_MISSING.format(name, sim.scene.similar(stem)))
    return handle


@function(_GROUP)
def get_object_alias(sim: "Session", handle: int, options: int = -1) -> str:
    """Return the alias of an object, or with options 1 and 2 its path."""
    thing = sim.scene.get(handle)
    path = sim.scene.path(thing)
    forms = {1: path, 2: path, 4: f"{thing.alias}__{handle}__", 5: path, 6: path}
    return forms.get(int(options), thing.alias)


@function(_GROUP)
def get_object_name(sim: "Session", handle: int, _options: Any = None) -> str:
    """Return the alias of an object."""
    return sim.scene.get(handle).alias


@function(_GROUP, "setObjectName")
def set_object_alias(sim: "Session", handle: int, alias: str, _options: Any = None) -> int:
    """Give an object another alias."""
    sim.scene.get(handle).alias = str(alias)
    return 1


@function(_GROUP)
def get_object_type(sim: "Session", handle: int) -> int:
    """Return the kind of an object, one of `sceneobject_…`."""
    return sim.scene.get(handle).kind


@function(_GROUP)
def is_handle(sim: "Session", handle: int, _type: int = -1) -> bool:
    """Return whether there is an object of a handle."""
    return handle in sim.scene.objects


@function(_GROUP)
def get_object_parent(sim: "Session", handle: int) -> int:
    """Return the parent of an object; -1: it has none."""
    return sim.scene.get(handle).parent


@function(_GROUP)
def get_object_child(sim: "Session", handle: int, index: int) -> int:
    """Return the child of an object at an index; -1: there is none."""
    children = [o.handle for o in sim.scene.objects.values() if o.parent == handle]
    return children[index] if 0 <= index < len(children) else -1


@function(_GROUP)
def get_objects_in_tree(sim: "Session", handle: int, kind: int = -2, options: int = 0) -> list[int]:
    """Return the objects of a tree, of one kind; options 1: without its root, 2: children only."""
    top = None if handle in (CONSTANTS["handle_scene"], _WORLD) else sim.scene.get(handle)
    found = list(sim.scene.below(top))
    if options & 2:
        found = [o for o in found if o.parent == (-1 if top is None else top.handle)]
    if top is not None and not options & 1:
        found = [top, *found]
    return [o.handle for o in found if kind in (CONSTANTS["handle_all"], o.kind)]


@function(_GROUP)
def get_objects(sim: "Session", index: int, kind: int) -> int:
    """Return the object of a kind at an index; -1: there is none."""
    found = [
        o.handle for o in sim.scene.objects.values() if kind in (CONSTANTS["handle_all"], o.kind)
    ]
    return found[index] if 0 <= index < len(found) else -1


# --- poses ---------------------------------------------------------------------------------------


def _frame(sim: "Session", thing: SceneObject, given: Any) -> SceneObject | None:
    """Return the object whose frame is meant; None: the world."""
    if given == _PARENT:
        return sim.scene.objects.get(thing.parent)
    return (
        None
        if given is None or given in (_WORLD, CONSTANTS["handle_scene"])
        else sim.scene.get(given)
    )


def _seen(sim: "Session", handle: int, given: Any) -> Pose:
    thing = sim.scene.get(handle)
    return sim.scene.pose_in(thing, _frame(sim, thing, given))


def _put(sim: "Session", handle: int, given: Any, change: Any) -> int:
    """Put an object where `change` takes its pose in a frame."""
    thing = sim.scene.get(handle)
    frame = _frame(sim, thing, given)
    pose = change(sim.scene.pose_in(thing, frame))
    sim.put(
        thing, pose if frame is None else composed(sim.scene.world_pose(frame, moves=True), pose)
    )
    return 1


@function(_GROUP)
def get_object_position(sim: "Session", handle: int, frame: Any = None) -> list[float]:
    """Return where an object is, in the world or the frame of another one [m]."""
    return list(_seen(sim, handle, frame)[0])


@function(_GROUP)
def get_object_orientation(sim: "Session", handle: int, frame: Any = None) -> list[float]:
    """Return its Euler angles alpha, beta, gamma [rad]."""
    return euler(_seen(sim, handle, frame)[1])


@function(_GROUP)
def get_object_quaternion(sim: "Session", handle: int, frame: Any = None) -> list[float]:
    """Return its orientation as x, y, z, w."""
    return list(_seen(sim, handle, frame)[1])


@function(_GROUP)
def get_object_pose(sim: "Session", handle: int, frame: Any = None) -> list[float]:
    """Return x, y, z [m] and its orientation x, y, z, w."""
    pose = _seen(sim, handle, frame)
    return [*pose[0], *pose[1]]


@function(_GROUP)
def get_object_matrix(sim: "Session", handle: int, frame: Any = None) -> list[float]:
    """Return the first three rows of its matrix, 12 numbers."""
    return matrix(_seen(sim, handle, frame))


@function(_GROUP)
def set_object_position(sim: "Session", handle: int, where: Any, frame: Any = None) -> int:
    """Put an object somewhere, at rest [m]."""
    where, frame = flipped(where, frame)
    goal = point(where)
    return _put(sim, handle, frame, lambda pose: (goal, pose[1]))


@function(_GROUP)
def set_object_orientation(sim: "Session", handle: int, angles: Any, frame: Any = None) -> int:
    """Turn an object to Euler angles [rad]."""
    angles, frame = flipped(angles, frame)
    turn = of_euler(numbers(angles, 3))
    return _put(sim, handle, frame, lambda pose: (pose[0], turn))


@function(_GROUP)
def set_object_quaternion(sim: "Session", handle: int, turn: Any, frame: Any = None) -> int:
    """Turn an object to x, y, z, w."""
    turn, frame = flipped(turn, frame)
    goal = turn_of(numbers(turn, 4))
    return _put(sim, handle, frame, lambda pose: (pose[0], goal))


@function(_GROUP)
def set_object_pose(sim: "Session", handle: int, pose: Any, frame: Any = None) -> int:
    """Put an object to x, y, z and x, y, z, w."""
    pose, frame = flipped(pose, frame)
    goal = pose_of(pose)
    return _put(sim, handle, frame, lambda _pose: goal)


@function(_GROUP)
def set_object_matrix(sim: "Session", handle: int, rows: Any, frame: Any = None) -> int:
    """Put an object to a matrix of 12 numbers."""
    rows, frame = flipped(rows, frame)
    goal = of_matrix(rows)
    return _put(sim, handle, frame, lambda _pose: goal)


@function(_GROUP, "getVelocity")
def get_object_velocity(sim: "Session", handle: int, _options: int = 0) -> tuple[Any, Any]:
    """Return its velocity [m/s] and angular velocity [rad/s] in the world."""
    return sim.velocity_of(sim.scene.get(handle))


@function(_GROUP)
def set_object_parent(
    sim: "Session", handle: int, parent: int = -1, keeps_place: bool = True
) -> int:
    """Give an object another parent; a body then goes along with a link, as if held."""
    thing = sim.scene.get(handle)
    above = None if parent in (-1, None) else sim.scene.get(parent)
    if thing.kind == SHAPE and not thing.is_root:
        raise ApiError(f"{sim.scene.path(thing)} is a link of a robot, which stays its part.")
    pose = sim.scene.world_pose(thing)
    thing.parent = -1 if above is None else above.handle
    if not keeps_place:
        pose = composed(NOWHERE if above is None else sim.scene.world_pose(above), thing.pose)
    if thing.link is None or not keeps_place:
        sim.put(thing, pose)
    if thing.is_root and thing.link is not None:
        sim.hold(thing, above)
    return 1


# --- making, removing, properties ----------------------------------------------------------------


@function(_GROUP)
def create_dummy(sim: "Session", _size: float = 0.01, *_more: Any) -> int:
    """Make a frame without a body."""
    return sim.scene.add_dummy("Dummy").handle


@function(_GROUP)
def create_primitive_shape(sim: "Session", form: int, sizes: Any, _options: int = 0) -> int:
    """Make a cuboid, a sphere or a cylinder, before the simulation."""
    if form not in _SHAPES:
        raise ApiError("only cuboids, spheroids, cylinders and discs are available in stepbus.")
    return sim.make_shape(_SHAPES[form], numbers(sizes, 3))


@function(_GROUP)
def create_pure_shape(
    sim: "Session", form: int, options: int, sizes: Any, mass: float, _precision: Any = None
) -> int:
    """Make a cuboid (0), a sphere (1) or a cylinder (2) with a mass, before the simulation."""
    kinds = {0: "box", 1: "sphere", 2: "cylinder"}
    if form not in kinds:
        raise ApiError("only cuboids, spheres and cylinders are available in stepbus.")
    handle = sim.make_shape(kinds[form], numbers(sizes, 3))
    changes = {"static": bool(options & 16), "respondable": bool(options & 8)}
    sim.shape_changed(handle, mass=number(mass), **changes)
    return handle


@function(_GROUP)
def remove_objects(sim: "Session", handles: Any, *_more: Any) -> None:
    """Remove objects that the script has made."""
    for handle in handles:
        sim.remove(sim.scene.get(handle))


@function(_GROUP, "removeModel")
def remove_object(sim: "Session", handle: int) -> int:
    """Remove an object that the script has made."""
    sim.remove(sim.scene.get(handle))
    return 1


@function(_GROUP, "getObjectInt32Parameter", "getObjectIntParam")
def get_object_int32_param(sim: "Session", handle: int, parameter: int) -> int:
    """Return a property of an object, such as the control mode of a joint."""
    return int(sim.property_of(sim.scene.get(handle), parameter))


@function(_GROUP, "getObjectFloatParameter")
def get_object_float_param(sim: "Session", handle: int, parameter: int) -> float:
    """Return a property of an object, such as the velocity of a joint."""
    return float(sim.property_of(sim.scene.get(handle), parameter))


@function(
    _GROUP,
    "setObjectFloatParam",
    "setObjectInt32Parameter",
    "setObjectFloatParameter",
    "setObjectIntParam",
)
def set_object_int32_param(sim: "Session", handle: int, parameter: int, value: float) -> int:
    """Set a property of an object, such as the control mode of a joint."""
    thing = sim.scene.get(handle)
    value = number(value)
    if thing.joint is not None:
        control = sim.controls[thing.joint.name]
        if parameter == CONSTANTS["jointintparam_dynctrlmode"]:
            control.drive(int(value))
        elif parameter == CONSTANTS["jointintparam_motor_enabled"] and not value:
            control.drive(0)
        elif parameter == CONSTANTS["jointintparam_ctrl_enabled"]:
            control.drive(8 if value else 4)
        elif parameter == CONSTANTS["jointfloatparam_maxvel"]:
            control.fastest = abs(value)
    elif thing.is_root and parameter == _STATIC and thing.name in sim.edits.primitives:
        sim.shape_changed(handle, static=bool(value))
    elif thing.is_root and parameter == _RESPONDABLE and thing.name in sim.edits.primitives:
        sim.shape_changed(handle, respondable=bool(value))
    thing.values[str(parameter)] = value
    return 1


@function(_GROUP)
def set_model_property(_sim: "Session", _handle: int, _value: int) -> int:
    """Do nothing: what a model shows or collides with is in its URDF."""
    return 1


@function(_GROUP)
def set_shape_color(sim: "Session", handle: int, name: Any, part: int, colour: Any) -> int:
    """Give a shape a colour: red, green, blue, 0 to 1."""
    del name, part
    sim.shape_changed(handle, colour=tuple(numbers(colour, 3)))
    return 1


@function(_GROUP)
def get_shape_color(sim: "Session", handle: int, *_more: Any) -> tuple[int, list[float]]:
    """Return 1 and the colour of a shape."""
    thing = sim.scene.get(handle)
    return 1, list(thing.values.get("colour", (0.75, 0.75, 0.75)))


@function(_GROUP)
def set_shape_mass(sim: "Session", handle: int, mass: float) -> None:
    """Give a body of one link another mass, before the simulation [kg]."""
    sim.shape_changed(handle, mass=number(mass))


@function(_GROUP)
def get_shape_mass(sim: "Session", handle: int) -> float:
    """Return the mass of a link [kg]."""
    thing = sim.scene.get(handle)
    if thing.link is None or thing.kind != SHAPE:
        raise ApiError("object is not a shape.")
    return float(thing.values.get("mass", sim.scene.engine.mass(thing.link)))


@function(_GROUP)
def get_shape_bb(sim: "Session", handle: int) -> tuple[list[float], list[float]]:
    """Return size [m] and pose of the box around a link, along the axes of the world."""
    thing = sim.scene.get(handle)
    if thing.link is None:
        raise ApiError("object is not a shape.")
    low, high = sim.scene.engine.box(thing.link)
    middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    return [b - a for a, b in zip(low, high, strict=True)], [*middle, 0.0, 0.0, 0.0, 1.0]


# --- poses of a script's own ---------------------------------------------------------------------


@function("matrices")
def build_matrix(_sim: "Session", where: Any, angles: Any) -> list[float]:
    """Return the matrix of a position and Euler angles."""
    return matrix((point(where), of_euler(numbers(angles, 3))))


@function("matrices")
def build_pose(_sim: "Session", where: Any, angles: Any, *_more: Any) -> list[float]:
    """Return the pose of a position and Euler angles."""
    return [*point(where), *of_euler(numbers(angles, 3))]


@function("matrices")
def multiply_matrices(_sim: "Session", one: Any, other: Any) -> list[float]:
    """Return the product of two matrices."""
    return matrix(composed(of_matrix(one), of_matrix(other)))


@function("matrices")
def multiply_poses(_sim: "Session", one: Any, other: Any) -> list[float]:
    """Return the product of two poses."""
    pose = composed(pose_of(one), pose_of(other))
    return [*pose[0], *pose[1]]


@function("matrices", "getMatrixInverse")
def invert_matrix(_sim: "Session", rows: Any) -> list[float]:
    """Return the inverse of a matrix."""
    from stepbus_plant.geometry import Geometry  # noqa: PLC0415

    return matrix(Geometry().inverse(of_matrix(rows)))


@function("matrices")
def multiply_vector(_sim: "Session", rows: Any, vector: Any) -> list[float]:
    """Return a point that a matrix, or a pose, takes to the world."""
    frame = pose_of(rows) if len(rows) == 7 else of_matrix(rows)
    return list(composed(frame, (point(vector), NOWHERE[1]))[0])


@function("matrices")
def get_euler_angles_from_matrix(_sim: "Session", rows: Any) -> list[float]:
    """Return the Euler angles of a matrix [rad]."""
    return euler(of_matrix(rows)[1])


@function("matrices")
def matrix_to_pose(_sim: "Session", rows: Any) -> list[float]:
    """Return a matrix as a pose."""
    pose = of_matrix(rows)
    return [*pose[0], *pose[1]]


@function("matrices")
def pose_to_matrix(_sim: "Session", pose: Any) -> list[float]:
    """Return a pose as a matrix."""
    return matrix(pose_of(pose))
