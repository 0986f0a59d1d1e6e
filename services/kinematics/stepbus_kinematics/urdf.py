"""Load a URDF into Pinocchio, and list what it lacks."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_participant import package_path, read_urdf_text, suggest
from stepbus_schemas import WiringError

_URL = re.compile(r"package://[^\"'<>]+")


def load_urdf(path: Path) -> tuple[str, Any]:
    """Return the text of a URDF or `.xacro` and Pinocchio's model of it.

    Raises WiringError for a file that Pinocchio cannot read.
    """
    text = read_urdf_text(path)
    try:
        return text, pin.buildModelFromXML(text)
    except ValueError as exc:
        raise WiringError(f"{path} is not a URDF that Pinocchio can read") from exc


def with_mesh_files(text: str, folder: Path) -> str:
    """Return the text of a URDF with the file name of each mesh instead of its `package://` URL.

    folder: of the URDF.
    """
    return _URL.sub(lambda url: str(package_path(url[0], folder)), text)


def movable_joints(model: Any) -> tuple[str, ...]:
    """Return the names of all joints that move, in Pinocchio's order."""
    return tuple(model.names)[1:]


def joint_problems(model: Any, joints: Sequence[str], file: str, *, bounded: bool) -> list[str]:
    """Return a sentence for each joint that is missing or of a type that cannot be moved.

    bounded: every joint needs position limits.
    """
    movable = movable_joints(model)
    problems = [
        f"joint {name!r} is not in {file}{suggest(name, movable)}"
        for name in joints
        if name not in movable
    ]
    for name in (name for name in joints if name in movable):
        joint = model.getJointId(name)
        if bounded and not _has_limits(model, joint):
            problems.append(f"joint {name!r} of {file} has no position limits")
        elif model.nvs[joint] != 1:
            freedoms = f"{model.nvs[joint]} degrees of freedom"
            problems.append(f"joint {name!r} of {file} has {freedoms}; a controller needs 1")
    return problems


def _has_limits(model: Any, joint: int) -> bool:
    at = model.idx_qs[joint]
    lower, upper = model.lowerPositionLimit[at], model.upperPositionLimit[at]
    return bool(model.nqs[joint] == 1 and -np.inf < lower < upper < np.inf)


def link_problems(model: Any, links: Sequence[str], file: str) -> list[str]:
    """Return a sentence for each link that the model lacks."""
    known = link_names(model)
    return [
        f"link {name!r} is not in {file}{suggest(name, known)}"
        for name in links
        if name not in known
    ]


def link_names(model: Any) -> tuple[str, ...]:
    """Return the names of all links, in Pinocchio's order."""
    return tuple(frame.name for frame in model.frames if frame.type == pin.FrameType.BODY)


def posture_of(model: Any, positions: Mapping[str, float]) -> Any:
    """Return the neutral posture of a model with some joints elsewhere, shape (nq,) [rad or m]."""
    q = pin.neutral(model)
    for name, value in positions.items():
        q[model.idx_qs[model.getJointId(name)]] = value
    return q
