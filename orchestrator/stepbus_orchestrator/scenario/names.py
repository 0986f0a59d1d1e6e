"""Reads what a file names: texts of YAML, `filename` of URDF and XML, imports of Python and JS."""

import ast
import re
from pathlib import Path
from xml.etree import ElementTree as ET

from stepbus_participant import SettingsError, read_text
from stepbus_participant.parameters import texts_in
from stepbus_schemas import WiringError

_JS_FILE = re.compile(r"""(?:"(\.{1,2}/[^"\n]+)"|'(\.{1,2}/[^'\n]+)')""")
_JS_SUFFIXES = (".js", ".mjs", ".cjs")
_YAML_SUFFIXES = (".yaml", ".yml")
_XML_SUFFIXES = (".urdf", ".xml", ".xacro", ".sdf", ".mjcf", ".srdf")


class FileUnreadable(WiringError):
    """A file cannot be read; the text goes behind its name: `:3: not YAML: …`."""


def names_in(path: Path) -> list[str]:
    """Return the texts in a file that may be names of files; none for types that name none.

    Raises FileUnreadable.
    """
    suffix = path.suffix.lower()
    if suffix in _YAML_SUFFIXES:
        return _yaml_texts(_read(path))
    if suffix in _XML_SUFFIXES:
        return _xml_names(_read(path))
    if suffix in _JS_SUFFIXES:
        return [double or single for double, single in _JS_FILE.findall(_read(path))]
    return []


def modules_in(path: Path) -> list[str]:
    """Return the modules a Python file imports; raises FileUnreadable."""
    if path.suffix != ".py":
        return []
    try:
        tree = ast.parse(_read(path))
    except SyntaxError as exc:
        raise FileUnreadable(f":{exc.lineno}: not Python: {exc.msg}") from exc
    except ValueError as exc:
        raise FileUnreadable(f": not Python: {exc}") from exc
    return [name for node in ast.walk(tree) for name in _imported(node)]


def _imported(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        return [node.module] if node.module else [alias.name for alias in node.names]
    return []


def _read(path: Path) -> str:
    try:
        return read_text(path)
    except OSError as exc:
        raise FileUnreadable(f" cannot be read: {exc.strerror}") from exc
    except UnicodeDecodeError as exc:
        raise FileUnreadable(f" is not UTF-8 text (byte {exc.start})") from exc


def _xml_names(text: str) -> list[str]:
    """Return the attributes `filename` and `file` of all elements, and each <uri> of an SDF."""
    try:
        root = ET.fromstring(text)  # noqa: S314  the user's own file; expat stops expansions
    except ET.ParseError as exc:
        raise FileUnreadable(f":{exc.position[0]}: not XML: {exc}") from exc
    values = [element.get(key) for element in root.iter() for key in ("filename", "file")]
    uris = ((element.text or "").strip() for element in root.iter("uri"))
    values += [uri.replace("model://", "package://") for uri in uris]
    return [value for value in values if value]


def _yaml_texts(text: str) -> list[str]:
    try:
        return texts_in("", text)
    except SettingsError as exc:
        problem = exc.problems[0]
        line = f":{problem.line}" if problem.line else ""
        raise FileUnreadable(f"{line}: {problem.message}") from exc
