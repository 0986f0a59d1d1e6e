"""Models of robots: URDF as it is, xacro expanded, SDF and MJCF converted."""

from pathlib import Path
from xml.dom import minidom
from xml.etree import ElementTree as ET
from xml.parsers.expat import ExpatError

from stepbus_schemas import WiringError

from .files import package_path, read_file, read_text
from .mjcf import mjcf_to_urdf
from .packages import need
from .sdf import sdf_to_urdf
from .urdf_check import Element, parse_urdf, urdf_problems
from .urdf_clean import clean

# S318: the files are the user's own, and expat itself stops an expansion without end.


def read_urdf_text(path: Path) -> str:
    """Return the text of a robot's URDF, checked and cleaned: it can be simulated (`urdf_clean`).

    path: a URDF, which is returned as it is where nothing is to be cleaned, an SDF or an MJCF (its
    root is <mujoco>), which are converted (see `sdf` and `mjcf`), or a `.xacro`, which is expanded
    by the package xacro. There,
    `<xacro:include filename="package://<package>/<path>"/>` is found like every `package://` of
    stepbus, and relative names are relative to the file that has them.
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
        return _expand(path), True
    try:
        text = read_text(path)
    except OSError as exc:
        raise WiringError(f"cannot read {path}: {exc.strerror}") from exc
    except UnicodeDecodeError as exc:
        raise WiringError(f"{path} is not UTF-8 text (byte {exc.start})") from exc
    if path.suffix.lower() == ".sdf":
        return sdf_to_urdf(_parsed(path, text), path), True
    # A URDF, too, may have an element of that name.
    if "<mujoco" in text and (root := _parsed(path, text)).tag == "mujoco":
        return mjcf_to_urdf(root, path), True
    return text, False


def _parsed(path: Path, text: str) -> Element:
    try:
        return parse_urdf(text)
    except ExpatError as exc:
        raise WiringError(f"{path}:{exc.lineno}: is not XML: {exc}") from exc


def _expand(path: Path) -> str:
    (xacro,) = need(str(path), "xacro")
    document = _with_includes(path, ())
    try:
        # It keeps the files it is in between calls, where one has failed.
        xacro.init_stacks(str(path))
        xacro.process_doc(document)
    except (xacro.XacroException, ExpatError, OSError, RuntimeError) as exc:
        # A RuntimeError is a missing attribute, or (RecursionError) a macro that calls itself.
        reason = " ".join(str(exc).split())
        raise WiringError(f"{path}: cannot expand xacro: {reason}") from exc
    # PyBullet cuts lines after 1023 characters.
    text: str = document.toprettyxml(indent="  ")
    return text


def _with_includes(path: Path, above: tuple[Path, ...]) -> minidom.Document:
    """Return a file with the content of the files it includes; above: those that include it."""
    if path in above:
        raise WiringError(f"{path}: includes itself via {above[-1]}")
    try:
        document = minidom.parseString(read_file(path))  # noqa: S318
    except OSError as exc:
        raise WiringError(f"cannot read {path}: {exc.strerror}") from exc
    except ExpatError as exc:
        raise WiringError(f"{path}: is not XML: {exc}") from exc
    for element in document.getElementsByTagName("xacro:include"):
        name = element.getAttribute("filename")
        # What xacro has to work out, it also has to find.
        if "$" not in name and not element.hasAttribute("ns"):
            _replace(element, _with_includes(_included(path, name), (*above, path)))
    return document


def _included(path: Path, name: str) -> Path:
    if not name.startswith("package://"):
        return path.parent / name
    try:
        return package_path(name, path.parent)
    except WiringError as exc:
        raise WiringError(f"{path}: {exc}") from exc


def _replace(element: minidom.Element, included: minidom.Document) -> None:
    """Put the content of a document where an element of another one is."""
    parent, document = element.parentNode, element.ownerDocument
    if parent is None or document is None or included.documentElement is None:
        return
    content = document.createDocumentFragment()
    for child in included.documentElement.childNodes:
        content.appendChild(document.importNode(child, True))
    parent.replaceChild(content, element)
