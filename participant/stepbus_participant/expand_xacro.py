"""Expands xacro, with the packages that `package://` finds where xacro asks ROS for them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.dom import minidom
from xml.parsers.expat import ExpatError

from stepbus_schemas import WiringError

from .files import package_folder, package_path, read_file
from .packages import need


def expand(path: Path) -> str:
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
    except (xacro.XacroException, RuntimeError) as exc:
        # A RuntimeError is a missing attribute, or (RecursionError) a file or macro in itself.
        reason = " ".join(str(exc).split())
        raise WiringError(f"{path}: cannot expand xacro: {reason}") from exc
    # PyBullet cuts lines after 1023 characters.
    text: str = document.toprettyxml(indent="  ")
    return text


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
