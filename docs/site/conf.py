"""The documentation site: `make docs` builds it into build/docs, with warnings as errors.

The source folder is the root of the repository, so that a link from page to page is the same file
here, on the site and in a checkout. Nothing on a built page comes from another host.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import re
import sys
import textwrap
from functools import reduce
from importlib import import_module
from operator import or_
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
from docutils import nodes
from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx
from sphinx.errors import PycodeError
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective
from sphinx.util.typing import stringify_annotation

import stepbus
from stepbus_tools.theme import NIGHT, NUMBER_FONT, PAPER, TEXT_FONT

project = "stepbus"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "scenarios/*/*/*.md",
    "store/*.md",
    "store/docs/**",
    "store/*/scenarios/*/*.md",
    "examples/README.md",
    "examples/coppelia/systems/README.md",
    "examples/fmu_drives/README.md",
    "benchmarks/README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "SECURITY.md",
    "CODE_OF_CONDUCT.md",
]
exclude_patterns = [".*", "build", "runs"]

myst_heading_anchors = 3
myst_fence_as_directive = ["mermaid"]
suppress_warnings = ["myst.header"]  # a page of a scenario starts where its README does

default_role = "py:obj"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
python_use_unqualified_type_names = True
maximum_signature_line_length = 88

html_theme = "furo"
html_title = "stepbus"
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
html_additional_pages = {"index": "to_start.html"}
templates_path = ["."]
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_favicon = html_logo = "mark.svg"
html_theme_options = {
    "top_of_page_buttons": [],
    "light_css_variables": {
        "font-stack": TEXT_FONT,
        "font-stack--monospace": NUMBER_FONT,
        "color-brand-primary": PAPER["accent"],
        "color-brand-content": PAPER["accent"],
    },
    "dark_css_variables": {
        "color-brand-primary": NIGHT["accent"],
        "color-brand-content": NIGHT["accent"],
        "color-background-primary": NIGHT["paper"],
        "color-background-secondary": NIGHT["raised"],
        "color-sidebar-caption-text": NIGHT["soft"],
    },
}

GROUPS = ("Functions", "Classes", "Messages", "Errors", "Types and constants", "Modules")
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
QUOTED = re.compile(r"(?<!`)`([^`]+)`(?!`)")
ERRORS = {
    name: "stepbus" if name in stepbus.__all__ else "stepbus.errors"
    for name in stepbus.errors.__all__
    if isinstance(value := getattr(stepbus.errors, name), type) and issubclass(value, BaseException)
}
"""Error → where it is documented."""


def _group(value: Any) -> str:
    """Return under which heading of the API reference a public object stands."""
    if inspect.ismodule(value):
        return "Modules"
    if not isinstance(value, type):
        return "Functions" if inspect.isroutine(value) else "Types and constants"
    if issubclass(value, BaseException):
        return "Errors"
    return "Messages" if issubclass(value, stepbus.Message) else "Classes"


def _directive(module: str, name: str, group: str) -> str:
    """Return the reStructuredText that documents one public object."""
    if group == "Types and constants":
        return f".. py:data:: {module}.{name}\n\n   {_comment(name)}\n"
    word = {"Functions": "autofunction", "Errors": "autoexception"}.get(group, "autoclass")
    lines = [f".. {word}:: {module}.{name}"]
    if group != "Functions":
        lines += ["   :members:"]
    if group == "Errors":
        lines += ["   :show-inheritance:"]
    return "\n".join(lines) + "\n"


def _comment(name: str) -> str:
    """Return the text below the assignment of a constant, wherever it is defined.

    Raises LookupError when a public constant has none.
    """
    for module in sorted(name for name in sys.modules if name.startswith("stepbus")):
        with contextlib.suppress(PycodeError):
            documented = ModuleAnalyzer.for_module(module).find_attr_docs()
            if text := documented.get(("", name)):
                return QUOTED.sub(_quoted, " ".join(text).strip())
    raise LookupError(f"stepbus.{name} has no docstring")


def reference(module: str) -> str:
    """Return the reference of a module in reStructuredText: every name of its `__all__`."""
    public = import_module(module)
    groups: dict[str, list[str]] = {group: [] for group in GROUPS}
    for name in getattr(public, "__all__", ()):
        # What stands in `stepbus` itself as well is described there.
        if module != "stepbus" and name in stepbus.__all__:
            continue
        groups[_group(getattr(public, name))].append(name)
    parts = []
    for group, names in groups.items():
        if group == "Modules":
            parts += [
                _section(f"{module}.{name}") + reference(f"{module}.{name}") for name in names
            ]
        elif names:
            parts += [_section(group) if module == "stepbus" else ""]
            parts += [_directive(module, name, group) for name in names]
    return "\n".join(parts)


def _section(title: str) -> str:
    return f"\n{title}\n{'-' * len(title)}\n\n"


def _add_reference(_app: Sphinx, page: str, source: list[str]) -> None:
    if page == "docs/reference/api":
        source[0] += "\n" + reference("stepbus")


def _format(
    _app: Sphinx, what: str, _name: str, value: Any, _options: Any, lines: list[str]
) -> None:
    """Make a list of the parameters and fields that a docstring explains, and link its errors.

    Docstrings explain several in one paragraph: `scenario: a name or a path. set: overrides.`
    """
    names = _names(value) if what in ("function", "method", "class") else []
    start = re.compile(rf"(?:^|(?<=[.;] ))((?:{'|'.join(names)})(?:, \w+)*): ")
    formatted: list[str] = []
    fenced = FENCE.sub(_code_block, "\n".join(lines))
    for paragraph in fenced.split("\n\n"):
        text = paragraph.replace("\n", " ") if names and start.match(paragraph) else paragraph
        parts = start.split(text) if text is not paragraph else [text]
        if len(parts) > 1:
            last, raises, errors = parts[-1].partition(" Raises ")
            pairs = zip(parts[1::2], [*parts[2:-1:2], last], strict=True)
            text = "\n".join(f"- **{name}**: {meaning.strip()}" for name, meaning in pairs)
            text += f"\n\n{raises.strip()} {errors}" if raises else ""
        formatted += [*text.split("\n"), ""]
    link = re.compile(rf"(?<![`\w.])({'|'.join(sorted(ERRORS))})(?![`\w])")
    text = QUOTED.sub(_quoted, "\n".join(formatted))
    lines[:] = link.sub(_error_link, text).split("\n")


def _error_link(match: re.Match[str]) -> str:
    return f":py:exc:`~{ERRORS[match[1]]}.{match[1]}`"


def _code_block(match: re.Match[str]) -> str:
    return f".. code-block:: {match[1]}\n\n{textwrap.indent(match[2], '   ')}"


def _quoted(match: re.Match[str]) -> str:
    """Leave a name, which becomes a link where the site has it; make any other code literal."""
    return match[0] if re.fullmatch(r"[\w.]+", match[1]) else f"``{' '.join(match[1].split())}``"


def _names(value: Any) -> list[str]:
    """Return the parameters of a function, the fields of a class."""
    try:
        return [*inspect.signature(value).parameters, *getattr(value, "__annotations__", ())]
    except (TypeError, ValueError):
        return []


def _add_fields(
    _app: Sphinx, what: str, _name: str, value: Any, _options: Any, lines: list[str]
) -> None:
    """Add the fields of a message with their descriptions, which are metadata of their types."""
    if what != "class" or not issubclass(value, stepbus.Message):
        return
    schema = msgspec.json.schema(value)["$defs"].get(value.__name__, {})
    for field, description in schema.get("properties", {}).items():
        lines.extend(["", f"- ``{field}``: {description.get('description', '')}"])


class Mermaid(SphinxDirective):
    """Shows the drawing that scripts/diagrams.py made of a Mermaid block."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the picture; warns when the block has changed since it was drawn."""
        page = Path(self.env.docname).name
        drawing = Path(__file__).parents[1] / "pictures" / f"{page}.svg"
        block = "\n".join(self.content) + "\n"
        name = hashlib.sha256(block.encode()).hexdigest()[:16]
        if not drawing.exists() or name not in drawing.read_text(encoding="utf-8")[:60]:
            return [
                self.state_machine.reporter.warning(
                    f"{drawing.name} does not show this diagram; run scripts/diagrams.py",
                    line=self.lineno,
                )
            ]
        self.env.note_dependency(str(drawing))
        return [nodes.image(uri=f"/docs/pictures/{drawing.name}", alt=f"diagram of {page}")]


def _sign(
    _app: Sphinx, what: str, _name: str, value: Any, _options: Any, signature: str, returned: str
) -> tuple[str, str]:
    """Show the fields of a message with their plain types; the table below has the rest."""
    if what != "class" or not issubclass(value, msgspec.Struct):
        return signature, returned
    shown = [
        f"{field.name}: {stringify_annotation(_plain(field.type), 'smart')}{_default(field)}"
        for field in msgspec.structs.fields(value)
    ]
    kinds = [item.kind for item in inspect.signature(value).parameters.values()]
    if inspect.Parameter.KEYWORD_ONLY in kinds:
        shown.insert(kinds.index(inspect.Parameter.KEYWORD_ONLY), "*")
    return f"({', '.join(shown)})", returned


def _plain(annotation: Any) -> Any:
    """Return a type without what `Annotated` adds to it, at any depth."""
    if get_origin(annotation) is Annotated:
        return _plain(get_args(annotation)[0])
    arguments = get_args(annotation)
    if get_origin(annotation) is Literal or not arguments:
        return annotation
    plain = tuple(_plain(argument) for argument in arguments)
    if isinstance(annotation, UnionType):
        return reduce(or_, plain)
    return get_origin(annotation)[plain]


def _default(field: Any) -> str:
    if field.default is not msgspec.NODEFAULT:
        return f" = {field.default!r}"
    return (
        f" = {field.default_factory()!r}" if field.default_factory is not msgspec.NODEFAULT else ""
    )


def setup(app: Sphinx) -> None:
    """Add what follows the code by itself."""
    app.add_directive("mermaid", Mermaid)
    app.add_lexer("hex", TextLexer)
    app.connect("source-read", _add_reference)
    app.connect("autodoc-process-docstring", _format)
    app.connect("autodoc-process-signature", _sign)
    app.connect("autodoc-process-docstring", _add_fields)
