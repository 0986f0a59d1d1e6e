"""Robots as Pinocchio and MuJoCo read them, without stepbus; the base is fixed at the origin."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import xacro
from lxml import etree

Values = Mapping[str, float]
"""By the names of joints."""
Pose = tuple[Any, Any]
"""Position, shape (3,) [m], and rotation matrix, shape (3, 3)."""


class Library:
    """A robot in one of the libraries.

    joints: their numbers, by name. limits: (lower, upper) of each [rad or m]. mimics: joint → the
    joint that it follows, multiplier and offset. mass: [kg]. light: of links without a mass, to
    which engines have to give one [kg]. floats: whether its root can leave the world.
    """

    joints: Mapping[str, int]
    limits: Mapping[str, tuple[float, float]]
    mimics: Mapping[str, tuple[str, float, float]]
    mass: float
    light = 0.0
    floats = True

    def poses(self, q: Values) -> dict[str, Pose]:
        """Return the pose of each link."""
        raise NotImplementedError

    def gravity(self, q: Values) -> dict[str, float]:
        """Return the torque of each joint against gravity, without couplings [N·m or N]."""
        raise NotImplementedError

    def holding(self, q: Values) -> dict[str, float]:
        """Return the same against all that acts at rest, such as springs."""
        return self.gravity(q)

    def touches(self, q: Values) -> bool:
        """Return whether the file has contacts in a pose, which take part in the torques."""
        return False

    def moving(self, a: Values) -> dict[str, float]:
        """Return the torques of accelerations at the last pose [rad/s² or m/s²]."""
        raise NotImplementedError

    def followers(self, q: Mapping[str, Any]) -> dict[str, Any]:
        """Return the positions of the joints that follow others."""
        return {name: m * q[leader] + offset for name, (leader, m, offset) in self.mimics.items()}

    def projected(self, torque: Values) -> dict[str, float]:
        """Return the torques of the joints that follow none, with those of their followers."""
        own = dict(torque)
        for name, (leader, multiplier, _) in self.mimics.items():
            own[leader] += multiplier * own.pop(name)
        return own


class Pinocchio(Library):
    """A URDF or xacro. Its own mimic joints do not read three of these robots."""

    def __init__(self, path: Path) -> None:
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".xacro":
            text = xacro.process_file(str(path)).toxml()
        self._model = model = pin.buildModelFromXML(text)
        self._data = model.createData()
        self.joints = {name: model.getJointId(name) for name in list(model.names)[1:]}
        self.limits = {name: self._stops(number) for name, number in self.joints.items()}
        # Some files have prefixes of which no namespace is declared.
        root = etree.fromstring(text.encode(), etree.XMLParser(recover=True))
        rows = {row.getparent().get("name"): row.attrib for row in root.iterfind("joint/mimic")}
        self.mimics = {
            name: (row["joint"], float(row.get("multiplier", 1)), float(row.get("offset", 0)))
            for name, row in rows.items()
            if name in self.joints
        }
        self.mass = sum(inertia.mass for inertia in model.inertias)
        masses = [link.find("inertial/mass") for link in root.iterfind("link")]
        self.light = 1e-6 * sum(row is None or not float(row.get("value")) for row in masses)

    def _stops(self, number: int) -> tuple[float, float]:
        model, at = self._model, self._model.idx_qs[number]
        if model.nqs[number] == 2:
            return -np.inf, np.inf
        return model.lowerPositionLimit[at], model.upperPositionLimit[at]

    def _vector(self, q: Values) -> Any:
        vector = pin.neutral(self._model)
        for name, value in {**q, **self.followers(q)}.items():
            number = self.joints[name]
            at, size = self._model.idx_qs[number], self._model.nqs[number]
            vector[at : at + size] = value if size == 1 else (np.cos(value), np.sin(value))
        return vector

    def poses(self, q: Values) -> dict[str, Pose]:
        """See `Library`."""
        pin.framesForwardKinematics(self._model, self._data, self._vector(q))
        rows = zip(self._model.frames, self._data.oMf, strict=True)
        links = ((row.name, at) for row, at in rows if row.type == pin.FrameType.BODY)
        return {name: (at.translation.copy(), at.rotation.copy()) for name, at in links}

    def gravity(self, q: Values) -> dict[str, float]:
        """See `Library`."""
        vector = self._vector(q)
        pin.crba(self._model, self._data, vector)
        torque = pin.computeGeneralizedGravity(self._model, self._data, vector)
        return {name: torque[self._model.idx_vs[n]] for name, n in self.joints.items()}

    def moving(self, a: Values) -> dict[str, float]:
        """See `Library`."""
        at = [self._model.idx_vs[n] for n in self.joints.values()]
        torque = self._data.M[np.ix_(at, at)] @ [a[name] for name in self.joints]
        return dict(zip(self.joints, torque, strict=True))


class Mujoco(Library):
    """An MJCF without free joints and keyframes; linear equalities of joints are its mimics."""

    def __init__(self, path: Path) -> None:
        spec = mujoco.MjSpec.from_file(str(path))
        roots = spec.worldbody.bodies
        free = [j for k in roots for j in k.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
        self.floats = len(roots) == 1 and len(roots[0].joints) == len(free)
        if self.floats:
            roots[0].pos, roots[0].quat = (0, 0, 0), (1, 0, 0, 0)
            roots[0].alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        for row in (*free, *spec.keys, *(spec.worldbody.geoms if self.floats else ())):
            spec.delete(row)
        self._model = model = spec.compile()
        self._data = mujoco.MjData(model)
        names = [model.joint(n).name for n in range(model.njnt)]
        self.joints = {name: n for n, name in enumerate(names)}
        self.limits = {
            name: tuple(model.jnt_range[n]) if model.jnt_limited[n] else (-np.inf, np.inf)
            for name, n in self.joints.items()
        }
        rows = np.flatnonzero((model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & (model.eq_obj2id >= 0))
        self.mimics = {
            names[model.eq_obj1id[n]]: (names[model.eq_obj2id[n]], *model.eq_data[n, 1::-1])
            for n in rows
        }
        self.mass = float(model.body_mass[1:].sum())

    def _forward(self, q: Values) -> Any:
        for name, value in {**q, **self.followers(q)}.items():
            self._data.qpos[self._model.jnt_qposadr[self.joints[name]]] = value
        mujoco.mj_forward(self._model, self._data)
        return self._data

    def poses(self, q: Values) -> dict[str, Pose]:
        """See `Library`."""
        data = self._forward(q)
        rows = [data.body(n) for n in range(1, self._model.nbody)]
        return {row.name: (row.xpos.copy(), row.xmat.reshape(3, 3).copy()) for row in rows}

    def gravity(self, q: Values) -> dict[str, float]:
        """See `Library`."""
        return self._by_name(self._forward(q).qfrc_bias)

    def holding(self, q: Values) -> dict[str, float]:
        """See `Library`."""
        return self._by_name(self._forward(q).qfrc_bias - self._data.qfrc_passive)

    def touches(self, q: Values) -> bool:
        """See `Library`."""
        return bool(self._forward(q).ncon)

    def moving(self, a: Values) -> dict[str, float]:
        """See `Library`."""
        torque, rates = np.zeros((2, self._model.nv))
        for name, n in self.joints.items():
            rates[self._model.jnt_dofadr[n]] = a[name]
        mujoco.mj_mulM(self._model, self._data, torque, rates)
        return self._by_name(torque)

    def _by_name(self, torque: Any) -> dict[str, float]:
        return {name: float(torque[self._model.jnt_dofadr[n]]) for name, n in self.joints.items()}


def read(path: Path) -> Library:
    """Return a robot as the library of its format has it."""
    return Mujoco(path) if path.suffix == ".xml" else Pinocchio(path)
