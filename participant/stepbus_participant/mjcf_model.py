"""Models in MJCF, MuJoCo's XML, as MuJoCo compiles them."""

import logging
import os
import stat
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET
from xml.parsers.expat import ExpatError

from stepbus_schemas import WiringError

from .files import read_text
from .model_pose import Pose, pose_of_wxyz, shift
from .packages import need
from .urdf_check import parse_urdf

_log = logging.getLogger("stepbus_participant")
_DEFAULT_COLOUR = [0.5, 0.5, 0.5, 1.0]
"""That of a geom without its own, which has that of its material."""
_SEEN_GROUPS = range(3)
"""Groups of geoms that MuJoCo's viewer shows from the start."""
_FOLDERS = ("meshdir", "texturedir", "assetdir")


class Mjcf:
    """A compiled MJCF. mj: the package `mujoco`. model: its mjModel. warnings: of its compiler.

    Bodies, joints and geoms have their numbers in that; those without a name get one.
    """

    def __init__(self, path: Path, root: ET.Element) -> None:
        (self.mj,) = need(str(path), "mujoco")
        self.path = path
        # By default MuJoCo writes them into a file in the current folder.
        self.mj.set_mju_user_warning(_log.warning)
        _refuse_irregular(path, root, path.parent, set())
        try:
            with warnings.catch_warnings(record=True) as given:
                warnings.simplefilter("always")
                spec = self.mj.MjSpec.from_file(str(path.absolute()))
                self.model: Any = compiled(spec)
        except (ValueError, self.mj.FatalError) as exc:
            reason = _one_line(exc).removeprefix("XML Error: ").removeprefix("Error: ")
            raise WiringError(f"{path}: MuJoCo cannot compile it: {reason}") from exc
        self.warnings = [_one_line(row.message) for row in given]
        self._meshes = {mesh.id: mesh for mesh in spec.meshes}
        self.name: str = spec.modelname
        objects, model = self.mj.mjtObj, self.model
        self.bodies = self._names(objects.mjOBJ_BODY, model.nbody, "body")
        self.joints = self._names(objects.mjOBJ_JOINT, model.njnt, "joint")
        self.geoms = self._names(objects.mjOBJ_GEOM, model.ngeom, "geom")
        self.tendons = self._names(objects.mjOBJ_TENDON, model.ntendon, "tendon")
        self.actuators = self._names(objects.mjOBJ_ACTUATOR, model.nactuator, "actuator")
        self.plugins = self._names(objects.mjOBJ_PLUGIN, model.nplugin, "plugin")
        self.equalities = self._names(objects.mjOBJ_EQUALITY, model.neq, "equality")

    def _names(self, kind: Any, count: int, what: str) -> list[str]:
        """Return the names of all objects of a kind, each another one."""
        given = [self.mj.mj_id2name(self.model, kind, n) for n in range(count)]
        names: list[str] = []
        for n, name in enumerate(given):
            made = f"{what}{n}"
            while made in given:
                made += "_"
            names.append(name or made)
        return names

    def kind(self, enumeration: str, value: int) -> str:
        """Return a value of an enumeration in small letters, e.g. `box` of mjtGeom."""
        return str(getattr(self.mj, enumeration)(value).name).split("_", 1)[1].lower()

    def joint_kind(self, joint: int) -> str:
        """Return `hinge`, `slide`, `ball` or `free`."""
        return self.kind("mjtJoint", self.model.jnt_type[joint])

    def joints_of(self, body: int) -> list[int]:
        """Return the hinges and slides of a body, in the order in which they move it."""
        first, count = int(self.model.body_jntadr[body]), int(self.model.body_jntnum[body])
        numbers = range(first, first + count)
        return [joint for joint in numbers if self.joint_kind(joint) in {"hinge", "slide"}]

    def roots(self) -> list[int]:
        """Return the bodies that are right in the world."""
        return [n for n in range(1, self.model.nbody) if self.model.body_parentid[n] == 0]

    # --- geoms ----------------------------------------------------------------------------

    def geom_kind(self, geom: int) -> str:
        """Return `box`, `sphere`, … or `mesh`."""
        return self.kind("mjtGeom", self.model.geom_type[geom])

    def geoms_of(self, body: int) -> list[int]:
        """Return the geoms of a body."""
        first, count = int(self.model.body_geomadr[body]), int(self.model.body_geomnum[body])
        return list(range(first, first + count))

    def is_solid(self, geom: int) -> bool:
        """Return whether a geom touches others."""
        return bool(self.model.geom_contype[geom] or self.model.geom_conaffinity[geom])

    def is_seen(self, geom: int) -> bool:
        """Return whether MuJoCo's viewer shows a geom from the start."""
        return self.model.geom_group[geom] in _SEEN_GROUPS and self.colour(geom)[3] > 0

    def colour(self, geom: int) -> list[float]:
        """Return red, green, blue and alpha of a geom, 0 to 1: its own, or its material's."""
        colour, material = self.model.geom_rgba[geom].tolist(), self.model.geom_matid[geom]
        if material >= 0 and colour == _DEFAULT_COLOUR:
            colour = self.model.mat_rgba[material].tolist()
        # They have single precision.
        return [round(value, 6) for value in colour]

    def geom_pose(self, geom: int) -> Pose:
        """Return the pose of a geom in its body; of a mesh, that of the frame of its file."""
        pose = pose_of_wxyz(self.model.geom_pos[geom].tolist(), self.model.geom_quat[geom].tolist())
        if self.geom_kind(geom) != "mesh":
            return pose
        # MuJoCo has moved the mesh into the frame of its inertia.
        mesh = int(self.model.geom_dataid[geom])
        moved = pose_of_wxyz(
            self.model.mesh_pos[mesh].tolist(), self.model.mesh_quat[mesh].tolist()
        )
        scale, given = self.scale(geom), self._meshes[mesh]
        turned = pose_of_wxyz((0.0, 0.0, 0.0), list(given.refquat))
        to = shift([-a * b for a, b in zip(scale, given.refpos, strict=True)])
        # Of a mesh with a refquat, the scale is the same along all axes (see `mesh_problem`).
        return pose @ moved.inverse() @ turned.inverse() @ to

    def scale(self, geom: int) -> list[float]:
        """Return the scale of a mesh along each axis."""
        scale: list[float] = self.model.mesh_scale[self.model.geom_dataid[geom]].tolist()
        return scale

    def mesh_file(self, geom: int) -> Path | None:
        """Return the file of a mesh; None: it has none."""
        address = int(self.model.mesh_pathadr[self.model.geom_dataid[geom]])
        if address < 0:
            return None
        name: bytes = self.model.paths[address:].split(b"\0", 1)[0]
        return self.path.parent.absolute() / os.fsdecode(name)

    def mesh_problem(self, geom: int) -> str:
        """Return why a URDF cannot have a mesh as it is; empty: it can."""
        file = self.mesh_file(geom)
        if file is None or not file.is_file():
            return "has no file"
        if file.suffix.lower() not in {".stl", ".obj"}:
            return f"is in {file.name}"
        x, y, z = self.scale(geom)
        given = self._meshes[int(self.model.geom_dataid[geom])]
        is_turned = any(abs(value) > 1e-12 for value in list(given.refquat)[1:])
        return "has a refquat and a non-uniform scale" if is_turned and not x == y == z else ""


def _one_line(message: object) -> str:
    return " ".join(str(message).split())


def compiled(spec: Any) -> Any:
    """Return the model of a spec with all bodies and geoms, and without pictures and skins."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for element in (*spec.textures, *spec.skins):
        spec.delete(element)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    return spec.compile()


def _refuse_irregular(path: Path, root: ET.Element, folder: Path, seen: set[Path]) -> None:
    """Raise WiringError where a file that MuJoCo would open is a pipe or a device.

    path: of the file that the element `root` is of. folder: of the model.
    """
    seen.add(path)
    compilers = [compiler.get(key, "") for compiler in root.iter("compiler") for key in _FOLDERS]
    for element in root.iter():
        name = element.get("file")
        if not name:
            continue
        for file in _candidates(name, [folder, path.parent], compilers):
            if not stat.S_ISREG(file.stat().st_mode) and not file.is_dir():
                raise WiringError(f"{path}: {name!r} is not a regular file")
            if element.tag in {"include", "model"} and file.is_file() and file not in seen:
                _refuse_irregular(file, _root(file), folder, seen)


def _candidates(name: str, bases: Sequence[Path], below: Sequence[str]) -> Iterator[Path]:
    """Yield what there is of the files that a name can mean."""
    for file in dict.fromkeys(base / more / name for base in bases for more in ("", *below)):
        try:
            exists = file.exists()
        except (OSError, ValueError):
            exists = False
        if exists:
            yield file


def _root(file: Path) -> ET.Element:
    """Return the root of a file; of what is no XML, an empty one: MuJoCo says what is wrong."""
    try:
        return parse_urdf(read_text(file))
    except (OSError, UnicodeDecodeError, ExpatError):
        return ET.Element("none")
