"""Random poses that a robot can reach."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_participant import suggest
from stepbus_schemas import WiringError


class ReachablePoses:
    """Draws reachable poses of a robot from joint positions within its limits.

    path: URDF. frame: that the poses are given in. seed: of the draw.
    Raises WiringError for a file that is not a URDF.
    """

    def __init__(self, path: Path, frame: str, seed: int) -> None:
        try:
            self._model = pin.buildModelFromUrdf(str(path))
        except ValueError as exc:
            raise WiringError(f"{path} is not a URDF that Pinocchio can read") from exc
        self._data = self._model.createData()
        self._path = path
        self._frame = self._frame_id(frame)
        self._random = np.random.Generator(np.random.PCG64(seed))

    def check(self, tips: Sequence[str]) -> None:
        """Raise WiringError for unknown frames."""
        for tip in tips:
            self._frame_id(tip)

    def _frame_id(self, frame: str) -> int:
        if not self._model.existFrame(frame):
            known = [frame.name for frame in self._model.frames]
            raise WiringError(f"frame {frame!r} is not in {self._path}{suggest(frame, known)}")
        number: int = self._model.getFrameId(frame)
        return number

    def draw(self, tip: str) -> Any:
        """Return a pose of a frame, as `pinocchio.SE3`; joints that do not move it are neutral."""
        model, number = self._model, self._frame_id(tip)
        q = pin.neutral(model)
        for joint in model.supports[model.frames[number].parentJoint]:
            if joint:
                index = model.idx_qs[joint]
                q[index] = self._random.uniform(
                    model.lowerPositionLimit[index], model.upperPositionLimit[index]
                )
        pin.framesForwardKinematics(model, self._data, q)
        return self._data.oMf[self._frame].actInv(self._data.oMf[number])
