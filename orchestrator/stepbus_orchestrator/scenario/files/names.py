"""Reads what a file names: texts of YAML, `filename` of URDF and XML, imports of Python and JS."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from stepbus_schemas import WiringError

_XML = re.compile(r"""\b(?:filename|file)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+\.*([\w.]+)[ \t]+import\b|import[ \t]+([\w., \t]+))", re.MULTILINE
)
_JS_FILE = re.compile(r"""(?:"(\.{1,2}/[^"\n]+)"|'(\.{1,2}/[^'\n]+)')""")
_JS_SUFFIXES = (".js", ".mjs", ".cjs")
_YAML_SUFFIXES = (".yaml", ".yml")
_XML_SUFFIXES = (".urdf", ".xml", ".xacro", ".sdf", ".mjcf", ".srdf")


class FileUnreadable(WiringError):
    """A file cannot be read; the text goes behind its name: `:3: not YAML: …`."""


def names_in(path: Path) -> list[str]:
    """Return the texts in a file that may be names of files; none for kinds that name none.

    Raises FileUnreadable.
    """
    suffix = path.suffix.lower()
    if suffix in _YAML_SUFFIXES:
        return _yaml_texts(_read(path))
    if suffix in _XML_SUFFIXES:
        return [double or single for double, single in _XML.findall(_read(path))]
    if suffix in _JS_SUFFIXES:
        return [double or single for double, single in _JS_FILE.findall(_read(path))]
    return []


def modules_in(path: Path) -> list[str]:
    """Return the modules a Python file imports; raises FileUnreadable."""
    if path.suffix != ".py":
        return []
    found = [one or many for one, many in _IMPORT.findall(_read(path))]
    return [part.split()[0] for item in found for part in item.split(",") if part.split()]


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as exc:
        raise FileUnreadable(f" cannot be read: {exc.strerror}") from exc
    except UnicodeDecodeError as exc:
        raise FileUnreadable(f" is not UTF-8 text (byte {exc.start})") from exc


def _yaml_texts(text: str) -> list[str]:
    try:
        roots = list(YAML(pure=True).compose_all(io.StringIO(text)))
        seen: set[int] = set()
        return [item for root in roots for item in _texts(root, seen)]
    except MarkedYAMLError as exc:
        line = "" if exc.problem_mark is None else f":{exc.problem_mark.line + 1}"
        raise FileUnreadable(f"{line}: not YAML: {exc.problem}") from exc
    except YAMLError as exc:
        raise FileUnreadable(f": not YAML: {str(exc).splitlines()[0]}") from exc
    except RecursionError as exc:
        raise FileUnreadable(": is nested too deeply") from exc


def _texts(node: Node | None, seen: set[int]) -> Iterator[str]:
    """Return all texts below a node; aliases, which may contain themselves, once."""
    if node is None or id(node) in seen:
        return
    seen.add(id(node))
    if isinstance(node, ScalarNode):
        yield node.value
    elif isinstance(node, SequenceNode):
        for item in node.value:
            yield from _texts(item, seen)
    elif isinstance(node, MappingNode):
        for _, item in node.value:
            yield from _texts(item, seen)
