"""MJCF, MuJoCo's XML, as MuJoCo compiles it.

MuJoCo resolves defaults, includes and orientations. A link has the frame of its body, and positions
of joints are MuJoCo's. A description has no words for tendons, springs and others: a warning names
what it leaves out. Engine mujoco does not read the description, and simulates all of it.
"""

import logging
import math
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from stepbus_schemas import Point, WiringError

from .description import Inertial, Joint, JointType, Link, Mimic, Pose, RobotDescription, Shape

_log = logging.getLogger("stepbus_models")
_TYPES: Mapping[str, JointType] = {"hinge": "revolute", "slide": "prismatic", "ball": "ball"}
_DEFAULT_COLOUR = [0.5, 0.5, 0.5, 1.0]
"""That of a geom without its own, which has that of its material."""
_SEEN_GROUPS = range(3)
"""Groups of geoms that MuJoCo's viewer shows from the start."""
_SHOWN = 5
_UNLIMITED = 1e12


def read_mjcf(path: Path) -> RobotDescription:
    """Return the robot of an MJCF.

    Its root is the only body in the world, or the world, where that body has joints or there are
    several. Raises WiringError for what MuJoCo does not compile.
    """
    # By default MuJoCo writes its warnings into a file in the current folder.
    mujoco.set_mju_user_warning(_log.warning)
    try:
        with warnings.catch_warnings(record=True) as given:
            warnings.simplefilter("always")
            spec = mujoco.MjSpec.from_file(str(path.absolute()))
            model = _compiled(spec)
    except (ValueError, mujoco.FatalError) as exc:
        reason = _one_line(exc).removeprefix("XML Error: ").removeprefix("Error: ")
        raise WiringError(f"{path}: MuJoCo cannot compile it: {reason}") from exc
    if not np.isfinite(model.body_pos).all():
        raise WiringError(f"{path}: the position of a body is not finite")
    notes = [f"MuJoCo warns: {_one_line(row.message)}" for row in given]
    return _Reader(path, spec, model).robot(notes)


def _compiled(spec: Any) -> Any:
    """Return the model of a spec with all bodies and geoms, and without pictures and skins."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for element in (*spec.textures, *spec.skins):
        spec.delete(element)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    return spec.compile()


def _one_line(message: object) -> str:
    return " ".join(str(message).split())


class _Reader:
    """Reads a compiled model. Bodies, joints and geoms have their numbers in it."""

    def __init__(self, path: Path, spec: Any, model: Any) -> None:
        self._path, self._model = path, model
        self._name: str = spec.modelname
        self._meshes = {mesh.id: mesh for mesh in spec.meshes}
        self._bodies = self._names("body", model.nbody)
        self._joint_names = self._names("joint", model.njnt)
        self._mimics = self._followers()
        self._links: dict[str, Link] = {}
        self._joints: dict[str, Joint] = {}
        self._odd_shapes: list[str] = []

    def _names(self, what: str, count: int) -> list[str]:
        """Return the names of all objects of a kind; one without a name has a free one."""
        kind = getattr(mujoco.mjtObj, f"mjOBJ_{what.upper()}")
        given = [mujoco.mj_id2name(self._model, kind, n) for n in range(count)]
        return [name or _free(f"{what}{n}", given) for n, name in enumerate(given)]

    def _word(self, enumeration: str, value: int) -> str:
        """Return a value of an enumeration in small letters, e.g. `box` of mjtGeom."""
        return str(getattr(mujoco, enumeration)(value).name).split("_", 1)[1].lower()

    def robot(self, notes: Sequence[str]) -> RobotDescription:
        """Return the robot; notes: its first warnings."""
        model = self._model
        tops = [n for n in range(1, model.nbody) if model.body_parentid[n] == 0]
        is_world = len(tops) != 1 or bool(self._joints_of(tops[0]))
        root = 0 if is_world else tops[0]
        for body in range(0 if is_world else 1, model.nbody):
            self._links[self._bodies[body]] = self._link(body)
            if body != root:
                self._add_chain(body)
        left_out = "; ".join(
            f"{what} ({', '.join(names[:_SHOWN])}{', …' if len(names) > _SHOWN else ''})"
            for what, names in self._left_out(0 if is_world else 1).items()
            if names
        )
        said = f"controllers, views and exports leave out some of this MJCF: {left_out}"
        return RobotDescription(
            name=self._name or "model",
            path=self._path,
            format="mjcf",
            root=self._bodies[root],
            links=self._links,
            joints=self._joints,
            warnings=(*([said] if left_out else []), *notes),
        )

    def _left_out(self, first: int) -> dict[str, list[str]]:
        """Return kinds of things that a description has no words for, and their names.

        first: number of the first body of the robot; without the world, its geoms are left out.
        """
        model, joints = self._model, self._joint_names
        kinds = [self._word("mjtJoint", kind) for kind in model.jnt_type]
        stiff = model.jnt_stiffness.astype(bool) | model.jnt_stiffnesspoly.any(axis=1)
        active = set(np.flatnonzero(model.eq_active0)) - set(self._couplings())
        armature = np.unique(model.dof_jntid[model.dof_armature > 0])
        equalities = self._names("equality", model.neq)
        geoms = self._names("geom", model.ngeom) if first else []
        return {
            "ball joints": [
                name for name, kind in zip(joints, kinds, strict=True) if kind == "ball"
            ],
            "springs of joints": [joints[n] for n in np.flatnonzero(stiff)],
            "armature of joints": [joints[n] for n in armature],
            "tendons": self._names("tendon", model.ntendon),
            "constraints": [equalities[n] for n in sorted(active)],
            "gravity compensation of bodies": [
                self._bodies[n] for n in np.flatnonzero(model.body_gravcomp)
            ],
            "shapes": self._odd_shapes,
            "geoms of the world": geoms[: model.body_geomnum[0]],
            "flexes": self._names("flex", model.nflex),
            "plugins": self._names("plugin", model.nplugin),
        }

    # --- joints ---------------------------------------------------------------------------

    def _joints_of(self, body: int) -> list[int]:
        """Return the joints of a body but a free one, in the order in which they move it."""
        first, count = int(self._model.body_jntadr[body]), int(self._model.body_jntnum[body])
        return [joint for joint in range(first, first + count) if self._type(joint)]

    def _type(self, joint: int) -> JointType | None:
        """Return the type of a joint; None: it is free."""
        return _TYPES.get(self._word("mjtJoint", self._model.jnt_type[joint]))

    def _add_chain(self, body: int) -> None:
        """Add the joints from the parent of a body to the body.

        Between them, and where the last one is not at the origin of the body, are massless links.
        """
        model, name = self._model, self._bodies[body]
        parent = self._bodies[model.body_parentid[body]]
        at = _matrix(model.body_pos[body], model.body_quat[body])
        anchor, joints = np.zeros(3), self._joints_of(body)
        for joint in joints:
            # A slide is everywhere, so where the joint before it is.
            here = anchor if self._type(joint) == "prismatic" else model.jnt_pos[joint]
            at = at @ _matrix(here - anchor)
            child = name
            if joint != joints[-1] or here.any():
                child = _free(f"{self._joint_names[joint]}_link", [*self._bodies, *self._links])
                self._links[child] = Link(name=child)
            self._add_joint(joint, parent, child, at @ self._back(joint))
            parent, at, anchor = child, np.eye(4), here
        if parent != name:
            fixed = _free(f"{name}_fixed", [*self._joint_names, *self._joints])
            pose = _pose(at @ _matrix(-anchor))
            self._joints[fixed] = Joint(
                name=fixed, type="fixed", parent=parent, child=name, pose=pose
            )

    def _back(self, joint: int) -> Any:
        """Return what a joint does from the place that MJCF has the body in to position 0."""
        start = float(self._model.qpos0[self._model.jnt_qposadr[joint]])
        axis = self._model.jnt_axis[joint]
        if self._type(joint) == "prismatic":
            return _matrix(-start * axis)
        turn = np.array([1.0, 0.0, 0.0, 0.0])
        if self._type(joint) == "revolute":
            mujoco.mju_axisAngle2Quat(turn, axis, -start)
        return _matrix((0.0, 0.0, 0.0), turn)

    def _add_joint(self, joint: int, parent: str, child: str, at: Any) -> None:
        model, name = self._model, self._joint_names[joint]
        is_limited, freedom = bool(model.jnt_limited[joint]), model.jnt_dofadr[joint]
        kind = self._type(joint) or "fixed"
        lower, upper = model.jnt_range[joint].tolist() if is_limited else (None, None)
        self._joints[name] = Joint(
            name=name,
            type="continuous" if kind == "revolute" and not is_limited else kind,
            parent=parent,
            child=child,
            pose=_pose(at),
            axis=_point(model.jnt_axis[joint]),
            lower=lower,
            upper=upper,
            effort=self._effort(joint),
            damping=float(model.dof_damping[freedom]),
            friction=float(model.dof_frictionloss[freedom]),
            mimic=self._mimics.get(joint),
        )

    def _effort(self, joint: int) -> float:
        """Return what all actuators of a joint can do together [N·m or N]."""
        model, efforts = self._model, []
        for row in range(model.nactuator):
            kind = self._word("mjtTrn", int(model.actuator_trntype[row]))
            if kind in {"joint", "jointinparent"} and model.actuator_trnid[row, 0] == joint:
                efforts.append(self._force(row) * abs(float(model.actuator_gear[row, 0])))
        effort = sum(efforts) if efforts else math.inf
        if model.jnt_actfrclimited[joint]:
            effort = min(effort, float(abs(model.jnt_actfrcrange[joint]).max()))
        return min(effort, _UNLIMITED)

    def _force(self, row: int) -> float:
        """Return the largest force of an actuator; infinite: nothing limits it."""
        model = self._model
        if model.actuator_forcelimited[row]:
            return float(abs(model.actuator_forcerange[row]).max())
        is_motor = (
            self._word("mjtGain", int(model.actuator_gaintype[row])) == "fixed"
            and self._word("mjtBias", int(model.actuator_biastype[row])) == "none"
        )
        if is_motor and model.actuator_ctrllimited[row]:
            gain = abs(float(model.actuator_gainprm[row, 0]))
            return gain * float(abs(model.actuator_ctrlrange[row]).max())
        return math.inf

    def _couplings(self) -> Iterator[int]:
        """Yield the active equality constraints that keep a joint where another one takes it."""
        model = self._model
        for row in range(model.neq):
            is_joint = self._word("mjtEq", model.eq_type[row]) == "joint"
            is_linear = model.eq_obj2id[row] >= 0 and not model.eq_data[row, 2:5].any()
            if model.eq_active0[row] and is_joint and is_linear:
                yield row

    def _followers(self) -> dict[int, Mimic]:
        """Return the joints that follow one that follows none itself."""
        model, direct = self._model, dict[int, tuple[int, float, float]]()
        for row in self._couplings():
            joint, leader = int(model.eq_obj1id[row]), int(model.eq_obj2id[row])
            own, other = (float(model.qpos0[model.jnt_qposadr[n]]) for n in (joint, leader))
            constant, slope = model.eq_data[row, :2].tolist()
            direct[joint] = leader, slope, own + constant - slope * other
        return {joint: self._resolved(direct, joint) for joint in direct}

    def _resolved(self, direct: Mapping[int, tuple[int, float, float]], joint: int) -> Mimic:
        leader, multiplier, offset = direct[joint]
        for _ in direct:
            if leader not in direct:
                name = self._joint_names[leader]
                return Mimic(joint=name, multiplier=multiplier, offset=offset)
            leader, slope, constant = direct[leader]
            multiplier, offset = multiplier * slope, multiplier * constant + offset
        name = self._joint_names[joint]
        raise WiringError(f"{self._path}: joint {name!r} follows itself through its couplings")

    # --- links ----------------------------------------------------------------------------

    def _link(self, body: int) -> Link:
        model = self._model
        first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        shapes = [(n, self._shape(n)) for n in range(first, first + count)]
        known = [(n, shape) for n, shape in shapes if shape is not None]
        return Link(
            name=self._bodies[body],
            inertial=self._inertial(body),
            visuals=tuple(shape for geom, shape in known if self._is_seen(geom)),
            collisions=tuple(shape for geom, shape in known if self._is_solid(geom)),
        )

    def _inertial(self, body: int) -> Inertial | None:
        model, mass = self._model, float(self._model.body_mass[body])
        if not mass:
            return None
        xx, yy, zz = model.body_inertia[body].tolist()
        pose = _pose(_matrix(model.body_ipos[body], model.body_iquat[body]))
        return Inertial(mass=mass, moments=(xx, yy, zz, 0.0, 0.0, 0.0), pose=pose)

    def _is_solid(self, geom: int) -> bool:
        return bool(self._model.geom_contype[geom] or self._model.geom_conaffinity[geom])

    def _is_seen(self, geom: int) -> bool:
        """Return whether MuJoCo's viewer shows a geom from the start."""
        return self._model.geom_group[geom] in _SEEN_GROUPS and self._colour(geom)[3] > 0

    def _colour(self, geom: int) -> tuple[float, ...]:
        """Return red, green, blue and alpha of a geom, 0 to 1: its own, or its material's."""
        colour, material = self._model.geom_rgba[geom].tolist(), self._model.geom_matid[geom]
        if material >= 0 and colour == _DEFAULT_COLOUR:
            colour = self._model.mat_rgba[material].tolist()
        # They have single precision.
        return tuple(round(value, 6) for value in colour)

    def _shape(self, geom: int) -> Shape | None:
        """Return the shape of a geom; None: a description has no such, or it is not to be had."""
        kind: Any = self._word("mjtGeom", self._model.geom_type[geom])
        mesh = self._mesh_file(geom) if kind == "mesh" else None
        size = self._model.geom_size[geom].tolist()
        sizes = {
            "box": [2 * half for half in size],
            "sphere": size[:1],
            "cylinder": [size[0], 2 * size[1]],
            "capsule": [size[0], 2 * size[1]],
            "mesh": None if mesh is None else self._scale(geom),
            "plane": [0.0, 0.0, 1.0],
        }
        if (extent := sizes.get(kind)) is None:
            if self._is_seen(geom) or self._is_solid(geom):
                body = self._bodies[self._model.geom_bodyid[geom]]
                self._odd_shapes.append(f"{kind} of {body}")
            return None
        return Shape(
            kind=kind,
            size=tuple(extent),
            mesh="" if mesh is None else str(mesh),
            pose=_pose(self._geom_at(geom, is_mesh=kind == "mesh")),
            rgba=self._colour(geom),
        )

    def _geom_at(self, geom: int, *, is_mesh: bool) -> Any:
        """Return the pose of a geom in its body; of a mesh, that of the frame of its file."""
        model = self._model
        at = _matrix(model.geom_pos[geom], model.geom_quat[geom])
        if not is_mesh:
            return at
        # MuJoCo has moved the mesh into the frame of its inertia.
        mesh = int(model.geom_dataid[geom])
        moved = _matrix(model.mesh_pos[mesh], model.mesh_quat[mesh])
        given = self._meshes[mesh]
        turned = _matrix((0.0, 0.0, 0.0), np.array(given.refquat))
        # Of a mesh with a refquat, the scale is the same along all axes (see `_mesh_file`).
        shifted = _matrix(-np.array(self._scale(geom)) * given.refpos)
        return at @ np.linalg.inv(moved) @ np.linalg.inv(turned) @ shifted

    def _scale(self, geom: int) -> list[float]:
        """Return the scale of a mesh along each axis."""
        scale: list[float] = self._model.mesh_scale[self._model.geom_dataid[geom]].tolist()
        return scale

    def _mesh_file(self, geom: int) -> Path | None:
        """Return the file of a mesh that others can read as it is; None: there is none."""
        mesh = int(self._model.geom_dataid[geom])
        address = int(self._model.mesh_pathadr[mesh])
        name: bytes = self._model.paths[address:].split(b"\0", 1)[0] if address >= 0 else b"/"
        file = self._path.parent.absolute() / os.fsdecode(name)
        if file.suffix.lower() not in {".stl", ".obj"} or not file.is_file():
            return None
        is_turned = any(abs(value) > 1e-12 for value in list(self._meshes[mesh].refquat)[1:])
        return None if is_turned and len(set(self._scale(geom))) > 1 else file


def _matrix(position: Any, quaternion: Any = (1.0, 0.0, 0.0, 0.0)) -> Any:
    """Return a pose as a matrix, shape (4, 4); quaternion: w first."""
    rotation, unit = np.zeros(9), np.array(quaternion, dtype=float)
    mujoco.mju_normalize4(unit)
    mujoco.mju_quat2Mat(rotation, unit)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.reshape(3, 3), position
    return matrix


def _pose(matrix: Any) -> Pose:
    r = matrix[:3, :3].tolist()
    pitch = math.atan2(-r[2][0], math.hypot(r[0][0], r[1][0]))
    yaw = math.atan2(r[1][0], r[0][0])
    # Roll is what is left behind pitch and yaw, also where x points along z and yaw is noise.
    s, c = math.sin(yaw), math.cos(yaw)
    roll = math.atan2(s * r[0][2] - c * r[1][2], c * r[1][1] - s * r[0][1])
    return Pose(xyz=_point(matrix[:3, 3]), rpy=(roll, pitch, yaw))


def _point(vector: Any) -> Point:
    x, y, z = vector.tolist()
    return x, y, z


def _free(wanted: str, names: Sequence[str | None]) -> str:
    """Return a name that is not among `names`."""
    while wanted in names:
        wanted += "_"
    return wanted
