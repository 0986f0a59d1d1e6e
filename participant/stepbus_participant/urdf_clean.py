"""Writes a robot so that all readers compute with the same one.

Readers differ where a URDF leaves room: PyBullet takes the length of an axis literally, and stops
continuous joints at limits that they do not have; an inertia that no body can have is 0 for
PyBullet, refused or balanced by MuJoCo, and taken as it is by Pinocchio.
"""

from collections.abc import Iterator, Sequence
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree as ET

from .urdf_check import LEFT_OUT, MOMENTS, Element, floats, moments

_ROUNDING = 1e-12
"""Of an axis of length 1."""
_DIGITS = 1e-3
"""By which a moment of three digits may exceed that of a body, as a share of the largest."""
_MARGIN = 1e-9
_SILENT = 1e-6
"""A change that is not worth a word, as a share of the largest moment."""


def clean(root: Element) -> bool:
    """Clean a robot without problems in place; return whether it has changed.

    Axes get the length 1, continuous joints lose `lower` and `upper`, `file://` meshes get a path.
    An inertia that no body can have becomes a third of its trace about every axis, as by MuJoCo's
    `balanceinertia`, or that of a plate where the numbers are only rounded; a sentence on it is
    added to the robot (see `urdf_warnings`).
    """
    joints: Sequence[Any] = root.findall("joint")
    links: Sequence[Any] = root.findall("link")
    files = [_as_path(mesh) for mesh in root.iter("mesh")]
    axes = [_unit(axis) for joint in joints for axis in joint.findall("axis")]
    stops = [_unlimited(joint) for joint in joints if joint.get("type") == "continuous"]
    repaired = [text for link in links for text in _balanced(link)]
    for text in filter(None, repaired):
        ET.SubElement(root, LEFT_OUT).text = text
    return any((*files, *axes, *stops)) or bool(repaired)


def _as_path(mesh: Any) -> bool:
    """Name the file of a mesh by its path; return whether it was named by a URL."""
    url = mesh.get("filename", "")
    if url.startswith("file://"):
        mesh.set("filename", unquote(url.removeprefix("file://")))
    return bool(url.startswith("file://"))


def _unit(axis: Any) -> bool:
    """Make an axis one of length 1; return whether it was another one."""
    vector = floats(axis.get("xyz", ""))
    length = sum(part * part for part in vector) ** 0.5
    if len(vector) != 3 or not length or abs(length - 1.0) < _ROUNDING:
        return False
    axis.set("xyz", " ".join(repr(part / length) for part in vector))
    return True


def _unlimited(joint: Any) -> bool:
    """Remove the stops of a joint; return whether it had any."""
    limit = joint.find("limit")
    given = [] if limit is None else [key for key in ("lower", "upper") if key in limit.attrib]
    for key in given:
        del limit.attrib[key]
    return bool(given)


def _balanced(link: Any) -> Iterator[str]:
    """Replace an inertia that no body can have; yield what was done, empty where it is rounding."""
    given = moments(link)
    repaired = None if given is None else _repaired(given)
    if given is None or repaired is None:
        return
    inertia = link.find("inertial/inertia")
    for key, value in zip(MOMENTS, repaired, strict=True):
        inertia.set(key, repr(value))
    change = max(abs(new - old) for new, old in zip(repaired, given, strict=True))
    text = (
        f"link {link.get('name')!r}: no body can have the inertia {_shown(given)} kg·m²: a "
        "principal moment is negative or exceeds the sum of the other two; "
        f"{_shown(repaired)} is used"
    )
    yield text if change > _SILENT * max(given[:3]) else ""


def _shown(inertia: Sequence[float]) -> str:
    """Return the moments, with the products where there are any."""
    count = 6 if any(inertia[3:]) else 3
    return f"({', '.join(f'{value:.7g}' for value in inertia[:count])})"


def _repaired(inertia: Sequence[float]) -> list[float] | None:
    """Return six moments [kg·m²] of a body near an inertia; None where it is that of a body."""
    mean = sum(inertia[:3]) / 3
    balanced = [mean, mean, mean, 0.0, 0.0, 0.0]
    if any(inertia[3:]):
        return _turned(inertia, balanced)
    least, middle, largest = sorted(inertia[:3])
    # Engines compare exactly, and reject a plate whose moments are rounded.
    if largest <= least + middle:
        return None
    if largest - least - middle > _DIGITS * largest:
        return balanced
    return [*(min(value, least + middle) for value in inertia[:3]), 0.0, 0.0, 0.0]


def _turned(inertia: Sequence[float], balanced: list[float]) -> list[float] | None:
    """Return the same for an inertia with products."""
    import numpy as np  # noqa: PLC0415  few robots need it

    xx, yy, zz, xy, xz, yz = inertia
    values, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    excess, largest = values[2] - values[0] - values[1], values[2]
    if values[0] < -_DIGITS * largest or excess > _DIGITS * largest:
        return balanced
    # Each engine turns it into its principal axes by itself, and must not arrive beyond the limit.
    if values[0] >= 0.0 and excess < -_MARGIN * largest:
        return None
    values[0] = max(values[0], 0.0)
    values[2] = min(largest, (values[0] + values[1]) * (1.0 - _MARGIN))
    full = axes @ np.diag(values) @ axes.T
    return [float(full[at]) for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
