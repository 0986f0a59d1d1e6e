"""Where the camera is, by forward kinematics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_participant.models import read_urdf_text
from stepbus_participant.settings import nearest
from stepbus_schemas import JointState, RunError, WiringError

from .geometry import Pose


class CameraMount:
    """A camera on a robot.

    path: URDF or xacro. joints: those that move the camera; all others stand at neutral. camera:
    link, its optical frame. frame: link that the camera's pose is given in, z up.
    Raises WiringError that lists all that the model lacks.
    """

    def __init__(self, path: Path, joints: Sequence[str], camera: str, frame: str) -> None:
        text = read_urdf_text(path)
        try:
            self._model: Any = pin.buildModelFromXML(text)
        except ValueError as exc:
            raise WiringError(f"{path} is not a URDF that Pinocchio can read") from exc
        self._check(path, joints, (camera, frame))
        self.joints = tuple(joints)
        self._data: Any = self._model.createData()
        # A joint may bear the name of a link.
        link = pin.FrameType.BODY
        self._frames = tuple(self._model.getFrameId(name, link) for name in (frame, camera))

    def _check(self, path: Path, joints: Sequence[str], links: Sequence[str]) -> None:
        movable = list(self._model.names)[1:]
        frames = [f.name for f in self._model.frames if f.type == pin.FrameType.BODY]
        problems = [
            f"joint {name!r} is not in {path.name}; {nearest(name, movable)}"
            for name in joints
            if name not in movable
        ]
        problems += [
            f"link {name!r} is not in {path.name}; {nearest(name, frames)}"
            for name in links
            if name not in frames
        ]
        if problems:
            raise WiringError("\n".join(problems))

    def pose(self, angles: Sequence[float]) -> Pose:
        """Return where the camera is in the frame; angles: of the joints, in their order [rad]."""
        q = pin.neutral(self._model)
        for name, angle in zip(self.joints, angles, strict=True):
            number = self._model.getJointId(name)
            at = self._model.idx_qs[number]
            # Pinocchio stores the cosine and sine of a continuous joint's angle.
            turning = self._model.nqs[number] == 2
            q[at : at + self._model.nqs[number]] = (
                (np.cos(angle), np.sin(angle)) if turning else angle
            )
        pin.framesForwardKinematics(self._model, self._data, q)
        frame, camera = (self._data.oMf[number] for number in self._frames)
        place = frame.actInv(camera)
        return Pose(rotation=place.rotation.copy(), position=place.translation.copy())


class JointReader:
    """Reads the angles of some joints, by name, from one port.

    port: its name, for messages. given: the port's names. wanted: those to read.
    Raises WiringError that lists the joints that are not there.
    """

    def __init__(self, port: str, given: Sequence[str], wanted: Sequence[str]) -> None:
        missing = [name for name in wanted if name not in given]
        if missing:
            rows = (f"input {port!r} has no joint {n!r}; {nearest(n, given)}" for n in missing)
            raise WiringError("\n".join(rows))
        self._port = port
        self._count = len(given)
        self._places = [given.index(name) for name in wanted]

    def read(self, state: JointState) -> list[float]:
        """Return the angles [rad], in the order wanted.

        Raises RunError for a state without them, or with one that is no finite number.
        """
        position = state.position
        if position is None or len(position) != self._count:
            came = "none" if position is None else len(position)
            raise RunError(f"input {self._port!r}: {self._count} positions expected, {came} came")
        angles = [position[place] for place in self._places]
        if not all(map(math.isfinite, angles)):
            raise RunError(f"input {self._port!r}: {angles} rad are not all finite numbers")
        return angles
