"""Reads a robot from its model file: URDF, xacro or MJCF."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.dom import minidom
from xml.parsers.expat import ExpatError

from stepbus_participant import need, package_folder, package_path, read_file, read_text
from stepbus_schemas import WiringError

from .description import RobotDescription
from .urdf import parse, read_urdf

_XACRO = re.compile(r"<xacro:\w|=[\"'][^\"'<>]*\$(\{|\((find|arg|eval|dirname)\b)")
"""What no URDF has, but a xacro file under its name."""
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def read_robot(path: Path) -> RobotDescription:
    """Return the robot of a URDF, a xacro file or an MJCF (its root is <mujoco>).

    Raises WiringError when the file cannot be read or expanded, or a package is missing, or with
    all that is wrong with the robot, one problem a line.
    """
    is_made = path.suffix.lower() == ".xacro"
    text = _expanded(path) if is_made else _text(path)
    if not is_made and _XACRO.search(_COMMENT.sub("", text)):
        text, is_made = _expanded(path), True
    try:
        root = parse(text)
    except ExpatError as exc:
        raise WiringError(f"{path}:{exc.lineno}: is not XML: {exc}") from exc
    if root.tag == "mujoco":
        need(str(path), "mujoco")
        from .mjcf import read_mjcf  # noqa: PLC0415  an optional package

        return read_mjcf(path)
    if root.tag == "sdf" or path.suffix.lower() == ".sdf":
        remedy = "export the robot as URDF from the program that made it"
        raise WiringError(f"{path}: SDF is not supported; {remedy}")
    return read_urdf(root, path, text, is_made=is_made)


def _text(path: Path) -> str:
    try:
        return read_text(path)
    except OSError as exc:
        raise WiringError(f"cannot read {path}: {exc.strerror}") from exc
    except UnicodeDecodeError as exc:
        raise WiringError(f"{path} is not UTF-8 text (byte {exc.start})") from exc


# --- xacro ------------------------------------------------------------------------------------


def _expanded(path: Path) -> str:
    """Return a xacro file as the text of a URDF.

    `$(find <package>)`, and `package://<package>/<path>` in the name of an included file, are found
    as every `package://` of stepbus; relative names are relative to the file that has them.
    Raises WiringError when a file cannot be read or expanded, or a package is missing.
    """
    xacro, arguments = need(str(path), "xacro", "xacro.substitution_args")
    try:
        document = minidom.parseString(read_file(path))  # noqa: S318  the file is the user's own
        # It keeps the files it is in between calls, where one has failed.
        xacro.init_stacks(str(path))
        with _packages_found(xacro, arguments, path):
            xacro.process_doc(document)
    except OSError as exc:
        raise WiringError(f"cannot read {exc.filename or path}: {exc.strerror}") from exc
    except ExpatError as exc:
        raise WiringError(f"{path}: is not XML: {exc}") from exc
    except RecursionError as exc:
        text = f"{xacro.filestack[-1]} includes itself, or a macro calls itself"
        raise WiringError(f"{path}: cannot expand xacro: {text}") from exc
    except (xacro.XacroException, RuntimeError) as exc:
        # A RuntimeError is a missing attribute.
        reason = " ".join(str(exc).split())
        raise WiringError(f"{path}: cannot expand xacro: {reason}") from exc
    urdf: str = document.toprettyxml(indent="  ")
    return urdf


@contextmanager
def _packages_found(xacro: Any, arguments: Any, path: Path) -> Iterator[None]:
    """Let xacro find packages without ROS: it has no other place where it may be told."""
    named, found = xacro.abs_filename_spec, arguments._eval_find

    def here() -> Path:
        return Path(xacro.filestack[-1] or path).parent

    def find(package: str) -> str:
        return str(package_folder(package, here()))

    def absolute(name: str) -> str:
        is_url = name.startswith("package://")
        return str(package_path(name, here())) if is_url else named(name)

    arguments._eval_find = arguments._eval_dict["find"] = find
    xacro.abs_filename_spec = absolute
    try:
        yield
    finally:
        arguments._eval_find = arguments._eval_dict["find"] = found
        xacro.abs_filename_spec = named
