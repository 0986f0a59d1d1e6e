"""What a law knows about the robot it controls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import STANDARD_GRAVITY, RobotModel, Vector
from stepbus_participant.settings import Settings
from stepbus_schemas import WiringError


@dataclass(frozen=True, kw_only=True)
class Robot:
    """The joints under control, in the order of every vector.

    effort_limit: largest torques, shape (n,) [N·m]. model: None where the scenario names no URDF.
    """

    joints: tuple[str, ...]
    effort_limit: Vector
    model: RobotModel | None = None

    def require_model(self) -> RobotModel:
        """Return the model; raises WiringError where the scenario names no URDF."""
        if self.model is None:
            raise WiringError("this law needs 'model', the robot's URDF")
        return self.model


def read_robot(settings: Settings) -> Robot | None:
    """Return the robot that `model`, `joints`, `gravity` and `effort_limit` describe.

    Returns None where they describe none; the settings say why.
    """
    joints = settings.names("joints") if settings.has("joints") else None
    gravity = settings.value("gravity", STANDARD_GRAVITY)
    gravity = settings.as_vector("gravity", gravity, ("x", "y", "z"))
    if settings.has("model"):
        model = _read_model(settings, joints, gravity)
        if model is None:
            return None
        limit = _read_limit(settings, model.joints, model.effort_limit.tolist())
        return Robot(joints=model.joints, effort_limit=limit, model=model)
    if joints is None:
        settings.note("model", "is missing; give a URDF, or 'joints' for a law that needs no model")
        return None
    return Robot(joints=joints, effort_limit=_read_limit(settings, joints, None))


def _read_model(
    settings: Settings, joints: tuple[str, ...] | None, gravity: Sequence[float]
) -> RobotModel | None:
    path = settings.file("model")
    if path is None or joints == ():
        return None
    try:
        return RobotModel(path, joints, gravity=gravity)
    except WiringError as exc:
        for problem in str(exc).splitlines():
            settings.note("model", problem)
        return None


def _read_limit(
    settings: Settings, joints: tuple[str, ...], in_model: list[float] | None
) -> Vector:
    """Return the effort limits: the scenario's, or else the model's, which may have left it out."""
    if in_model is None or settings.has("effort_limit"):
        return np.array(settings.per_name("effort_limit", joints, bound="positive"))
    settings.value("effort_limit", in_model)
    for name, limit in zip(joints, in_model, strict=True):
        if not 0 < limit < np.inf:
            settings.note(
                "effort_limit", f"is {limit:g} N·m for {name!r} in the model; set it here"
            )
    return np.array(in_model)
