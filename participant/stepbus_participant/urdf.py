"""Models of robots: URDF as it is, xacro expanded, SDF and MJCF converted."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET
from xml.parsers.expat import ExpatError

from stepbus_schemas import WiringError

from .expand_xacro import expand
from .files import read_text
from .mjcf import mjcf_to_urdf
from .sdf import sdf_to_urdf
from .urdf_check import Element, parse_urdf, urdf_problems
from .urdf_clean import clean

_XACRO = re.compile(r"<xacro:\w|=[\"'][^\"'<>]*\$\{")
"""What no URDF has, but a xacro file under its name."""
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def read_urdf_text(path: Path) -> str:
    """Return the text of a robot's URDF, checked and cleaned: it can be simulated (`urdf_clean`).

    path: a URDF, which is returned as it is where nothing is to be cleaned, an SDF or an MJCF (its
    root is <mujoco>), which are converted (see `sdf` and `mjcf`), or xacro, which is expanded (see
    `expand_xacro`).
    Raises WiringError when the file cannot be read or expanded, or a package is missing, or with
    all that is wrong with the robot, one a line.
    """
    return read_model(path)[0]


def read_model(path: Path) -> tuple[str, bool]:
    """Return what `read_urdf_text` does, and whether it is another text than that of the file.

    Its lines are then not those of the file.
    """
    text, is_made = _text(path)
    root = _parsed(path, text)
    problems = urdf_problems(root)
    if problems:
        rows = [(path if is_made else f"{path}:{line}", problem) for line, problem in problems]
        raise WiringError("\n".join(f"{place}: {problem}" for place, problem in rows))
    return (ET.tostring(root, encoding="unicode"), True) if clean(root) else (text, is_made)


def _text(path: Path) -> tuple[str, bool]:
    """Return the text of a URDF, and whether it was made from a file of another format."""
    if path.suffix.lower() == ".xacro":
        return expand(path), True
    try:
        text = read_text(path)
    except OSError as exc:
        raise WiringError(f"cannot read {path}: {exc.strerror}") from exc
    except UnicodeDecodeError as exc:
        raise WiringError(f"{path} is not UTF-8 text (byte {exc.start})") from exc
    if path.suffix.lower() == ".sdf":
        return sdf_to_urdf(_parsed(path, text), path), True
    if _XACRO.search(_COMMENT.sub("", text)):
        return expand(path), True
    # A URDF, too, may have an element of that name.
    if "<mujoco" in text and (root := _parsed(path, text)).tag == "mujoco":
        return mjcf_to_urdf(root, path), True
    return text, False


def _parsed(path: Path, text: str) -> Element:
    try:
        return parse_urdf(text)
    except ExpatError as exc:
        raise WiringError(f"{path}:{exc.lineno}: is not XML: {exc}") from exc
