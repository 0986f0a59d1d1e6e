"""MJCF, MuJoCo's XML, as MuJoCo compiles it.

MuJoCo resolves defaults, includes and orientations. A link has the frame of its body, and positions
of joints are MuJoCo's. A description has no words for tendons, flexes and others: a warning names
what it leaves out. Engine mujoco does not read the description, and simulates all of it.
"""

import logging
import math
import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.parsers.expat import ExpatError

import mujoco
import numpy as np

from stepbus_participant import read_text
from stepbus_schemas import Point, WiringError

from .description import Inertial, Joint, JointType, Link, Mimic, Pose, RobotDescription, Shape
from .urdf import is_file, parse

_log = logging.getLogger("stepbus_models")
_TYPES: dict[str, JointType] = {"hinge": "revolute", "slide": "prismatic", "ball": "ball"}
_DEFAULT_COLOUR = [0.5, 0.5, 0.5, 1.0]
"""That of a geom without its own, which has that of its material."""
_SEEN_GROUPS = range(3)
"""Groups of geoms that MuJoCo's viewer shows from the start."""
_UNLIMITED = 1e12


def read_mjcf(path: Path) -> RobotDescription:
    """Return the robot of an MJCF.

    Its root is the only body in the world, or the world, where that body has joints or there are
    several. Raises WiringError for what MuJoCo does not compile.
    """
    _refuse_irregular(path, path.parent, set())
    # By default MuJoCo writes its warnings into a file in the current folder.
    mujoco.set_mju_user_warning(_log.warning)
    try:
        with warnings.catch_warnings(record=True) as given:
            warnings.simplefilter("always")
            spec = read_spec(path)
            model = _compiled(spec)
    except (ValueError, mujoco.FatalError) as exc:
        raise WiringError(f"{path}: MuJoCo cannot compile it: {one_line(exc)}") from exc
    if not np.isfinite(model.body_pos).all():
        raise WiringError(f"{path}: the position of a body is not finite")
    notes = [f"MuJoCo warns: {one_line(row.message)}" for row in given]
    return _Reader(path, spec, model).robot(notes)


def read_spec(path: Path) -> Any:
    """Return the `MjSpec` of an MJCF, in which every body and joint has a name.

    Raises what MuJoCo does for a file that it does not parse.
    """
    spec = mujoco.MjSpec.from_file(str(path.absolute()))
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints)):
        for number, element in enumerate(elements):
            element.name = element.name or f"{kind}{number}"
    return spec


def _refuse_irregular(path: Path, folder: Path, seen: set[Path]) -> None:
    """Raise WiringError for a file in an MJCF that is not regular: MuJoCo would wait for a pipe."""
    seen.add(path)
    try:
        root = parse(read_text(path))
    except (OSError, UnicodeDecodeError, ExpatError):
        # MuJoCo says what is wrong.
        return
    keys = ("assetdir", "meshdir", "texturedir")
    below = {row.get(key, "") for row in root.iter("compiler") for key in keys} | {""}
    places = {base / more for base in (folder, path.parent) for more in below}
    for element in root.iter():
        for file in (place / element.get("file", ".") for place in places):
            if file.exists() and not (is_file(file) or file.is_dir()):
                raise WiringError(f"{path}: {element.get('file')!r} is not a regular file")
            if element.tag in {"include", "model"} and is_file(file) and file not in seen:
                _refuse_irregular(file, folder, seen)


def _compiled(spec: Any) -> Any:
    """Return the model of a spec with all bodies and geoms, and without pictures and skins."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for element in (*spec.textures, *spec.skins):
        spec.delete(element)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    return spec.compile()


def one_line(message: object) -> str:
    """Return a message of MuJoCo on one line."""
    return " ".join(str(message).removeprefix("XML Error: ").removeprefix("Error: ").split())


class _Reader:
    """Reads a compiled model. Bodies, joints and geoms have their numbers in it."""

    def __init__(self, path: Path, spec: Any, model: Any) -> None:
        self._path, self._model, self._name = path, model, spec.modelname
        self._meshes = {mesh.id: mesh for mesh in spec.meshes}
        self._bodies = [model.body(n).name for n in range(model.nbody)]
        self._joint_names = [model.joint(n).name for n in range(model.njnt)]
        self._links: dict[str, Link] = {}
        self._joints: dict[str, Joint] = {}
        self._odd_shapes = 0
        # Where all is while every joint is at position 0, which a `ref` moves.
        self._data: Any = mujoco.MjData(model)
        for joint in filter(self._moves, range(model.njnt)):
            self._data.qpos[model.jnt_qposadr[joint]] = 0.0
        mujoco.mj_kinematics(model, self._data)

    def robot(self, notes: Sequence[str]) -> RobotDescription:
        """Return the robot; notes: its first warnings."""
        tops = np.flatnonzero(self._model.body_parentid[1:] == 0) + 1
        root = 0 if len(tops) != 1 or self._joints_of(tops[0]) else int(tops[0])
        for body in range(root, self._model.nbody):
            self._links[self._bodies[body]] = self._link(body)
            if body != root:
                self._add_chain(body)
        counts = self._left_out(root).items()
        left_out = ", ".join(f"{what} ({count})" for what, count in counts if count)
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

    def _left_out(self, root: int) -> dict[str, int]:
        """Return the kinds of things that a description has no words for, and their numbers.

        root: number of the root body; where it is not the world, geoms of the world are left out.
        """
        model = self._model
        bends = model.jnt_stiffnesspoly.any(axis=1) | (model.jnt_springyield > 0)
        bends |= model.dof_dampingpoly[model.jnt_dofadr].any(axis=1)
        counts = {
            "ball joints": [self._type(n) for n in range(model.njnt)].count("ball"),
            "nonlinear springs and dampers of joints": bends.sum(),
            "tendons": model.ntendon,
            "constraints": model.eq_active0.sum() - len(list(self._couplings())),
            "shapes": self._odd_shapes,
            "geoms of the world": model.body_geomnum[0] if root else 0,
            "flexes": model.nflex,
            "plugins": model.nplugin,
        }
        return {what: int(count) for what, count in counts.items()}

    # --- joints ---------------------------------------------------------------------------

    def _joints_of(self, body: int) -> list[int]:
        """Return the joints of a body but a free one, in the order in which they move it."""
        first, count = int(self._model.body_jntadr[body]), int(self._model.body_jntnum[body])
        return [joint for joint in range(first, first + count) if self._type(joint)]

    def _type(self, joint: int) -> JointType | None:
        """Return the type of a joint; None: it is free."""
        return _TYPES.get(_word(mujoco.mjtJoint, self._model.jnt_type[joint]))

    def _moves(self, joint: int) -> bool:
        return self._type(joint) in {"revolute", "prismatic"}

    def _add_chain(self, body: int) -> None:
        """Add the joints from the parent of a body to the body.

        Between them, and where the last one is not at the origin of the body, are massless links.
        """
        model, name, joints = self._model, self._bodies[body], self._joints_of(body)
        parent, at = self._bodies[model.body_parentid[body]], self._frame(model.body_parentid[body])
        for joint in joints:
            here = self._frame(body)
            here[:3, 3] = self._data.xanchor[joint]
            if self._type(joint) == "prismatic":
                # Its anchor is where it is without its own motion.
                start = model.qpos0[model.jnt_qposadr[joint]]
                here[:3, 3] -= start * self._data.xaxis[joint]
            child = name
            if joint != joints[-1] or model.jnt_pos[joint].any():
                child = _free(f"{self._joint_names[joint]}_link", [*self._bodies, *self._links])
                self._links[child] = Link(name=child)
            self._add_joint(joint, parent, child, at, here)
            parent, at = child, here
        if parent != name:
            fixed = _free(f"{name}_fixed", [*self._joint_names, *self._joints])
            pose = _pose(at, self._frame(body))
            self._joints[fixed] = Joint(
                name=fixed, type="fixed", parent=parent, child=name, pose=pose
            )

    def _add_joint(self, joint: int, parent: str, child: str, at: Any, here: Any) -> None:
        """Add a joint; at, here: frames of its parent and child in the world."""
        model, name = self._model, self._joint_names[joint]
        is_limited, freedom = bool(model.jnt_limited[joint]), model.jnt_dofadr[joint]
        kind = self._type(joint) or "fixed"
        lower, upper = model.jnt_range[joint].tolist() if is_limited else (None, None)
        self._joints[name] = Joint(
            name=name,
            type="continuous" if kind == "revolute" and not is_limited else kind,
            parent=parent,
            child=child,
            pose=_pose(at, here),
            axis=_point(here[:3, :3].T @ self._data.xaxis[joint]),
            lower=lower,
            upper=upper,
            effort=self._effort(joint),
            damping=float(model.dof_damping[freedom]),
            friction=float(model.dof_frictionloss[freedom]),
            armature=float(model.dof_armature[freedom]),
            stiffness=float(model.jnt_stiffness[joint]),
            spring_rest=float(model.qpos_spring[model.jnt_qposadr[joint]]),
            mimic=self._mimic(joint),
        )

    def _effort(self, joint: int) -> float:
        """Return what all actuators of a joint can do together [N·m or N]."""
        model, efforts = self._model, []
        for row in range(model.nactuator):
            kind = _word(mujoco.mjtTrn, model.actuator_trntype[row])
            if kind in {"joint", "jointinparent"} and model.actuator_trnid[row, 0] == joint:
                efforts.append(self._force(row) * abs(float(model.actuator_gear[row, 0])))
        effort: float = sum(efforts) if efforts else math.inf
        if model.jnt_actfrclimited[joint]:
            effort = min(effort, float(abs(model.jnt_actfrcrange[joint]).max()))
        return min(effort, _UNLIMITED)

    def _force(self, row: int) -> float:
        """Return the largest force of an actuator; infinite: nothing limits it."""
        model = self._model
        if model.actuator_forcelimited[row]:
            return float(abs(model.actuator_forcerange[row]).max())
        kinds = {
            _word(mujoco.mjtGain, model.actuator_gaintype[row]),
            _word(mujoco.mjtBias, model.actuator_biastype[row]),
        }
        if kinds == {"fixed", "none"} and model.actuator_ctrllimited[row]:
            gain = abs(float(model.actuator_gainprm[row, 0]))
            return gain * float(abs(model.actuator_ctrlrange[row]).max())
        return math.inf

    def _couplings(self) -> Iterator[tuple[int, int, int, float, float]]:
        """Yield number, follower, leader, multiplier and offset of linear, active couplings."""
        model = self._model
        for row in np.flatnonzero(model.eq_active0).tolist():
            joint, leader = int(model.eq_obj1id[row]), int(model.eq_obj2id[row])
            is_joint = _word(mujoco.mjtEq, model.eq_type[row]) == "joint" and leader >= 0
            if is_joint and not model.eq_data[row, 2:5].any():
                own, other = (float(model.qpos0[model.jnt_qposadr[n]]) for n in (joint, leader))
                constant, slope = model.eq_data[row, :2].tolist()
                yield row, joint, leader, slope, own + constant - slope * other

    def _mimic(self, joint: int) -> Mimic | None:
        """Return the last joint that a joint follows, by way of others; None: it follows none."""
        rows = {row[1]: row[2:] for row in self._couplings()}
        last, multiplier, offset = joint, 1.0, 0.0
        for _ in rows:
            if last in rows:
                last, slope, constant = rows[last]
                multiplier, offset = multiplier * slope, multiplier * constant + offset
        if last in rows:
            name = self._joint_names[joint]
            raise WiringError(f"{self._path}: joint {name!r} follows itself through its couplings")
        leader = Mimic(joint=self._joint_names[last], multiplier=multiplier, offset=offset)
        return None if last == joint else leader

    # --- links ----------------------------------------------------------------------------

    def _frame(self, body: int) -> Any:
        """Return the frame of a body in the world, shape (4, 4)."""
        return _matrix(self._data.xpos[body], self._data.xmat[body])

    def _link(self, body: int) -> Link:
        model, frame = self._model, self._frame(body)
        first, mass = int(model.body_geomadr[body]), float(model.body_mass[body])
        geoms = range(first, first + int(model.body_geomnum[body]))
        shapes = {n: shape for n in geoms if (shape := self._shape(n, frame)) is not None}
        centre = _matrix(self._data.xipos[body], self._data.ximat[body])
        xx, yy, zz = model.body_inertia[body].tolist()
        moments = (xx, yy, zz, 0.0, 0.0, 0.0)
        inertial = Inertial(mass=mass, moments=moments, pose=_pose(frame, centre))
        return Link(
            name=self._bodies[body],
            inertial=inertial if mass else None,
            gravity_compensation=float(model.body_gravcomp[body]),
            visuals=tuple(shape for geom, shape in shapes.items() if self._is_seen(geom)),
            collisions=tuple(shape for geom, shape in shapes.items() if self._is_solid(geom)),
        )

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

    def _shape(self, geom: int, frame: Any) -> Shape | None:
        """Return the shape of a geom; None: a description has no such, or it is not to be had."""
        kind: Any = _word(mujoco.mjtGeom, self._model.geom_type[geom])
        size = self._model.geom_size[geom].tolist()
        at = _matrix(self._data.geom_xpos[geom], self._data.geom_xmat[geom])
        mesh: str | None = ""
        sizes = {
            "box": [2 * half for half in size],
            "sphere": size[:1],
            "cylinder": [size[0], 2 * size[1]],
            "capsule": [size[0], 2 * size[1]],
            "plane": [0.0, 0.0, 1.0],
        }
        if kind == "mesh":
            mesh, sizes[kind], moved = self._mesh(int(self._model.geom_dataid[geom]))
            at = at @ moved
        if kind not in sizes or mesh is None:
            self._odd_shapes += self._is_seen(geom) or self._is_solid(geom)
            return None
        return Shape(
            kind=kind,
            size=tuple(sizes[kind]),
            mesh=mesh,
            pose=_pose(frame, at),
            rgba=self._colour(geom),
        )

    def _mesh(self, mesh: int) -> tuple[str | None, list[float], Any]:
        """Return file and scale of a mesh, and its frame in that of its geom, shape (4, 4).

        The file is None where others cannot read the mesh as it is: of another format, or with a
        frame of its own.
        """
        model, given = self._model, self._meshes[mesh]
        address, scale = int(model.mesh_pathadr[mesh]), model.mesh_scale[mesh].tolist()
        name: bytes = model.paths[address:].split(b"\0", 1)[0] if address >= 0 else b"/"
        file = self._path.parent.absolute() / os.fsdecode(name)
        is_read = file.suffix.lower() in {".stl", ".obj"} and file.is_file()
        is_moved = given.refpos.any() or given.refquat[1:].any()
        # MuJoCo has moved the mesh into the frame of its inertia.
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.mesh_quat[mesh])
        frame = np.linalg.inv(_matrix(model.mesh_pos[mesh], rotation))
        return str(file) if is_read and not is_moved else None, scale, frame


def _word(enumeration: Any, value: Any) -> str:
    """Return a value of an enumeration in small letters, e.g. `box` of mjtGeom."""
    return str(enumeration(int(value)).name).split("_", 1)[1].lower()


def _matrix(position: Any, rotation: Any) -> Any:
    """Return a pose as a matrix, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.reshape(rotation, (3, 3)), position
    return matrix


def _pose(parent: Any, child: Any) -> Pose:
    """Return the pose of a frame in another one; both in the world, shape (4, 4)."""
    rotation = parent[:3, :3].T
    r = (rotation @ child[:3, :3]).tolist()
    pitch = math.atan2(-r[2][0], math.hypot(r[0][0], r[1][0]))
    yaw = math.atan2(r[1][0], r[0][0])
    # Roll is what is left behind pitch and yaw, also where x points along z and yaw is noise.
    s, c = math.sin(yaw), math.cos(yaw)
    roll = math.atan2(s * r[0][2] - c * r[1][2], c * r[1][1] - s * r[0][1])
    return Pose(xyz=_point(rotation @ (child - parent)[:3, 3]), rpy=(roll, pitch, yaw))


def _point(vector: Any) -> Point:
    x, y, z = vector.tolist()
    return x, y, z


def _free(wanted: str, names: Sequence[str | None]) -> str:
    """Return a name that is not among `names`."""
    while wanted in names:
        wanted += "_"
    return wanted
