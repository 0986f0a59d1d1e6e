"""Objects: how they are found, where they are, and what they are made of."""

import math
import sys
from collections.abc import Callable
from typing import Any

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.joints import FREE, POSITION, VELOCITY
from stepbus_coppelia.scene import NOWHERE, SHAPE, SceneObject, composed, relative
from stepbus_participant import suggest
from stepbus_plant.geometry import Pose

from . import table
from .table import CONSTANTS, Group, matrix, number, numbers, of_euler, of_matrix, point, pose_of

_WORLD, _PARENT, _ALL = (CONSTANTS[f"handle_{name}"] for name in ("world", "parent", "all"))
_NO_FRAMES = (None, _WORLD, CONSTANTS["handle_scene"])
_FORMS = {"cuboid": "box", "spheroid": "sphere", "cylinder": "cylinder", "disc": "cylinder"}
_SHAPES = {CONSTANTS[f"primitiveshape_{name}"]: form for name, form in _FORMS.items()}
_PURE = {0: "box", 1: "sphere", 2: "cylinder"}
_KEYS = {CONSTANTS[f"shapeintparam_{key}"]: key for key in ("static", "respondable")}
_MODES: dict[int, Callable[[float], int | None]] = {
    CONSTANTS["jointintparam_dynctrlmode"]: int,
    CONSTANTS["jointintparam_motor_enabled"]: lambda value: None if value else FREE,
    CONSTANTS["jointintparam_ctrl_enabled"]: lambda value: POSITION if value else VELOCITY,
}
_FASTEST = {CONSTANTS[f"jointfloatparam_{key}"] for key in ("maxvel", "upper_limit")}

_PARAMS = ("Int32Param", "IntParam", "Int32Parameter", "IntParameter", "FloatParameter")
"""Names of old and new, of functions that take any number."""


class Objects(Group):
    """Paths, trees, and what objects are made of."""

    title = "objects"
    also = {
        "getObjectName": "getObjectAlias",
        "setObjectName": "setObjectAlias",
        "getVelocity": "getObjectVelocity",
        "removeModel": "removeObject",
        **{f"getObject{k}": "getObjectFloatParam" for k in _PARAMS},
        **{f"setObject{k}": "setObjectFloatParam" for k in _PARAMS},
    }

    def getObject(self, path: str, options: Any = None) -> int:
        """Return the handle of a path such as `/arm/joint1`, `./x`, `x[1]`, `x{1}`, `/*/x`."""
        given = options if isinstance(options, dict) else {}
        start = self.sim.scene.objects.get(given.get("proxy", -1))
        handle = self.sim.scene.find(str(path), start, int(given.get("index", 0)))
        if handle == -1 and not given.get("noError"):
            known = suggest(path, map(self.sim.scene.path, self.sim.scene.objects.values()))
            text = f"object does not exist, or alias/path ({path!r}) is ill formatted"
            raise ApiError(text + known)
        return handle

    def getObjectHandle(self, name: str, options: Any = None) -> int:
        """Return the handle of a path, or of an older name such as `joint1` or `joint1#0`."""
        own, _, silent = str(name).partition("@")
        stem, _, copy = own.partition("#")
        index = {"index": int(copy) + 1} if copy.isdecimal() else {}
        more = {"noError": True} if silent == "silentError" else {}
        given = {**(options if isinstance(options, dict) else {}), **index, **more}
        return self.getObject(own if own[:1] in ("/", ".") else f"/{stem}", given)

    def getObjectAlias(self, handle: int, options: int = -1) -> str:
        """Return the alias of an object, or with options 1 and 2 its path."""
        thing = self.sim.scene.get(handle)
        path = self.sim.scene.path(thing)
        forms = dict.fromkeys((1, 2, 5, 6, 7, 8, 9), path) | {4: f"{thing.alias}__{handle}__"}
        return forms.get(int(options), thing.alias)

    def setObjectAlias(self, handle: int, alias: str, _options: Any = None) -> int:
        """Give an object another alias."""
        self.sim.scene.get(handle).alias = str(alias)
        return 1

    def getObjectType(self, handle: int) -> int:
        """Return the kind of an object, one of `sceneobject_…`."""
        return self.sim.scene.get(handle).kind

    def isHandle(self, handle: int, _type: int = -1) -> bool:
        """Return whether there is an object of a handle."""
        return handle in self.sim.scene.objects

    def getObjectParent(self, handle: int) -> int:
        """Return the parent of an object; -1: it has none."""
        return self.sim.scene.get(handle).parent

    def getObjectChild(self, handle: int, index: int) -> int:
        """Return the child of an object at an index; -1: there is none."""
        top = -1 if handle in _NO_FRAMES else self.sim.scene.get(handle).handle
        children = [o.handle for o in self.sim.scene.objects.values() if o.parent == top]
        return children[index] if 0 <= index < len(children) else -1

    def getObjectsInTree(self, handle: int, kind: int = _ALL, options: int = 0) -> list[int]:
        """Return the objects of a tree, of one kind; options 1: without its root, 2: children."""
        top = None if handle in _NO_FRAMES else self.sim.scene.get(handle)
        found = list(self.sim.scene.below(top))
        if options & 2:
            found = [o for o in found if o.parent == (-1 if top is None else top.handle)]
        if top is not None and not options & 1:
            found = [top, *found]
        return [o.handle for o in found if kind in (_ALL, o.kind)]

    def getObjectVelocity(self, handle: int, _options: int = 0) -> tuple[Any, Any]:
        """Return its velocity [m/s] and angular velocity [rad/s] in the world."""
        linear, angular = self.sim.scene.velocity_of(self.sim.scene.get(handle))
        return list(linear), list(angular)

    def setObjectParent(self, handle: int, parent: Any = -1, keeps_place: bool = True) -> int:
        """Give an object another parent; a body then goes along with a link, as if held."""
        scene, thing = self.sim.scene, self.sim.scene.get(handle)
        above = None if parent in (-1, None) else scene.get(parent)
        if thing.kind == SHAPE and not thing.is_root:
            raise ApiError(f"{scene.path(thing)} is a link of a robot, and stays its part.")
        if above is thing or above in list(scene.below(thing)):
            raise ApiError("object is ancestor of desired parent.")
        pose, before = scene.world_pose(thing), scene.objects.get(thing.parent)
        if not keeps_place:
            pose = scene.out_of(scene.into(pose, before), above)
        thing.parent = -1 if above is None else above.handle
        if thing.link is None or not keeps_place:
            scene.put(thing, pose)
        if thing.is_root:
            scene.hold(thing, above)
        return 1

    def createDummy(self, *_look: Any) -> int:
        """Make a frame without a body."""
        return self.sim.scene.add_dummy().handle

    def createPrimitiveShape(self, form: int, sizes: Any, _options: int = 0) -> int:
        """Make a cuboid, a sphere or a cylinder, before the simulation."""
        return self.sim.scene.make_shape(_kind(_SHAPES, form), numbers(sizes, 3))

    def createPureShape(self, form: int, options: int, sizes: Any, mass: float, *_: Any) -> int:
        """Make a cuboid (0), a sphere (1) or a cylinder (2) of a mass, before the simulation."""
        keys = {"static": bool(options & 16), "respondable": bool(options & 8)}
        size = numbers(sizes, 3)
        return self.sim.scene.make_shape(_kind(_PURE, form), size, mass=_mass(mass), **keys)

    def removeObjects(self, handles: Any, *_more: Any) -> None:
        """Remove objects that the script has made."""
        for handle in handles:
            self.removeObject(handle)

    def removeObject(self, handle: int) -> int:
        """Remove an object that the script has made."""
        self.sim.scene.discard(self.sim.scene.get(handle))
        return 1

    def getObjectFloatParam(self, handle: int, parameter: int) -> float:
        """Return a property of an object, such as the control mode of a joint."""
        thing, own = self.sim.scene.get(handle), dict[str, float]()
        if (joint := thing.joint) is not None:
            control, velocity = self.sim.scene.controls[joint.name], self.sim.scene.velocity
            own = {
                "jointintparam_dynctrlmode": control.mode,
                "jointintparam_motor_enabled": control.mode != FREE,
                "jointintparam_ctrl_enabled": control.mode == POSITION,
                "jointfloatparam_velocity": velocity[self.sim.scene.joint_index[joint.name]],
                "jointfloatparam_upper_limit": min(joint.upper, math.pi),
                "jointfloatparam_maxvel": min(control.fastest, sys.float_info.max),
            }
        elif thing.camera is not None:
            row = thing.camera.row
            larger = math.tan(row.fov / 2) * max(row.width / row.height, 1.0)
            own = {
                "visionintparam_resolution_x": row.width,
                "visionintparam_resolution_y": row.height,
                "visionfloatparam_perspective_angle": 2.0 * math.atan(larger),
                "visionfloatparam_near_clipping": row.near,
                "visionfloatparam_far_clipping": row.far,
            }
        elif thing.is_root:
            bodies = self.sim.scene.physics.world.bodies
            own["shapeintparam_static"] = bodies[thing.name].fixed_base
        known = {CONSTANTS[name]: value for name, value in own.items()}
        return float(known.get(parameter, thing.values.get(str(parameter), 0.0)))

    def setObjectFloatParam(self, handle: int, parameter: int, value: float) -> int:
        """Set a property of an object, such as the control mode of a joint."""
        thing, value = self.sim.scene.get(handle), number(value)
        if thing.joint is not None:
            control = self.sim.scene.controls[thing.joint.name]
            if parameter in _MODES and (mode := _MODES[parameter](value)) is not None:
                control.drive(mode)
            elif parameter in _FASTEST:
                control.fastest = abs(value)
        elif parameter in _KEYS:
            self.sim.scene.change(thing, _KEYS[parameter], bool(value))
        thing.values[str(parameter)] = value
        return 1

    def setShapeColor(self, handle: int, _name: Any, _part: int, colour: Any) -> int:
        """Give a shape a colour: red, green, blue, 0 to 1."""
        thing = self.sim.scene.get(handle)
        thing.values["colour"] = numbers(colour, 3)
        self.sim.scene.change(thing, "colour", tuple(thing.values["colour"]))
        return 1

    def getShapeColor(self, handle: int, *_more: Any) -> tuple[int, list[float]]:
        """Return 1 and the colour that a script has given a shape; grey: none."""
        return 1, self.sim.scene.get(handle).values.get("colour", [0.75, 0.75, 0.75])

    def setShapeMass(self, handle: int, mass: float) -> None:
        """Give a body of one link another mass, which it has from the next simulation on [kg]."""
        thing = self.sim.scene.get(handle)
        self.sim.scene.change(thing, "mass", _mass(mass))
        if self.sim.is_running:
            text = f"{self.sim.scene.path(thing)} has its new mass from the next simulation on"
            self.sim.logged.append(("warning", text))


def _mass(value: object) -> float:
    if (mass := number(value)) <= 0.0:
        raise ApiError(f"the mass must be above 0 kg, not {mass:g}.")
    return mass


def _kind(kinds: dict[int, str], form: int) -> str:
    if form not in kinds:
        raise ApiError("only cuboids, spheroids, cylinders and discs are available in stepbus.")
    return kinds[form]


class Poses(Group):
    """Where objects are, in the world or in the frame of another one."""

    title = "poses"

    def getObjectPosition(self, handle: int, frame: Any = None) -> list[float]:
        """Return where an object is [m]."""
        return list(self._seen(handle, frame)[0])

    def getObjectOrientation(self, handle: int, frame: Any = None) -> list[float]:
        """Return its Euler angles alpha, beta, gamma [rad]."""
        return table.euler(self._seen(handle, frame)[1])

    def getObjectQuaternion(self, handle: int, frame: Any = None) -> list[float]:
        """Return its orientation as x, y, z, w."""
        return list(self._seen(handle, frame)[1])

    def getObjectPose(self, handle: int, frame: Any = None) -> list[float]:
        """Return x, y, z [m] and its orientation x, y, z, w."""
        return _row(self._seen(handle, frame))

    def getObjectMatrix(self, handle: int, frame: Any = None) -> list[float]:
        """Return the first three rows of its matrix, 12 numbers."""
        return matrix(self._seen(handle, frame))

    def setObjectPosition(self, handle: int, where: Any, frame: Any = None) -> int:
        """Put an object somewhere, at rest [m]."""
        return self._put(handle, where, frame, lambda values, pose: (point(values), pose[1]))

    def setObjectOrientation(self, handle: int, angles: Any, frame: Any = None) -> int:
        """Turn an object to Euler angles [rad]."""
        return self._put(handle, angles, frame, lambda a, pose: (pose[0], of_euler(numbers(a, 3))))

    def setObjectQuaternion(self, handle: int, turn: Any, frame: Any = None) -> int:
        """Turn an object to x, y, z, w."""
        return self._put(handle, turn, frame, lambda q, p: (p[0], table.turn_of(numbers(q, 4))))

    def setObjectPose(self, handle: int, pose: Any, frame: Any = None) -> int:
        """Put an object to x, y, z and x, y, z, w."""
        return self._put(handle, pose, frame, lambda values, _: pose_of(values))

    def setObjectMatrix(self, handle: int, rows: Any, frame: Any = None) -> int:
        """Put an object to a matrix of 12 numbers."""
        return self._put(handle, rows, frame, lambda values, _pose: of_matrix(values))

    def _frame(self, thing: SceneObject, given: Any) -> SceneObject | None:
        """Return the object whose frame is meant; None: the world."""
        if given == _PARENT:
            return self.sim.scene.objects.get(thing.parent)
        return None if given in _NO_FRAMES else self.sim.scene.get(given)

    def _seen(self, handle: int, given: Any) -> Pose:
        thing = self.sim.scene.get(handle)
        return self.sim.scene.into(self.sim.scene.world_pose(thing), self._frame(thing, given))

    def _put(self, handle: int, values: Any, given: Any, to: Callable[[Any, Pose], Pose]) -> int:
        """Put an object where values take its pose in a frame; older scripts give that first."""
        scene, thing = self.sim.scene, self.sim.scene.get(handle)
        if isinstance(given, list | tuple):
            values, given = given, values
        frame = self._frame(thing, given)
        pose = to(values, scene.into(scene.world_pose(thing), frame))
        scene.put(thing, scene.out_of(pose, frame))
        return 1

    def buildMatrix(self, where: Any, angles: Any) -> list[float]:
        """Return the matrix of a position and Euler angles."""
        return matrix((point(where), of_euler(numbers(angles, 3))))

    def buildPose(self, where: Any, angles: Any, *_more: Any) -> list[float]:
        """Return the pose of a position and Euler angles."""
        return [*point(where), *of_euler(numbers(angles, 3))]

    def rotateAroundAxis(self, rows: Any, axis: Any, through: Any, angle: float) -> list[float]:
        """Return a matrix, or a pose, that is turned about an axis through a point [rad]."""
        half, length, at = number(angle) / 2, math.hypot(*point(axis)) or 1.0, point(through)
        turned = pose_of([*at, *(math.sin(half) * v / length for v in axis), math.cos(half)])
        before = relative((at, NOWHERE[1]), pose_of(rows) if len(rows) == 7 else of_matrix(rows))
        after = composed(turned, before)
        return _row(after) if len(rows) == 7 else matrix(after)

    def getEulerAnglesFromMatrix(self, rows: Any) -> list[float]:
        """Return the Euler angles of a matrix [rad]."""
        return table.euler(of_matrix(rows)[1])


def _row(pose: Pose) -> list[float]:
    return [*pose[0], *pose[1]]
