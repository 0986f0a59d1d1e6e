"""Packages import from each other only what these export."""

import ast
from functools import cache

import pytest
from support.exports import exported, source_of
from support.paths import CHECKOUT

ELSE = {"build", "runs", "tests"}
"""Folders without source of ours; tests see what is inside of a package."""


@cache
def imports():
    """Return all of `found_imports`."""
    return list(found_imports())


def found_imports():
    """Yield (file, module, names) of each import of ours from another package of ours."""
    folders = [path for path in CHECKOUT.iterdir() if path.is_dir() and path.name[0] != "."]
    for path in (path for folder in folders for path in sorted(folder.rglob("*.py"))):
        parts = path.relative_to(CHECKOUT).parts
        if ELSE.intersection(parts):
            continue
        name = str(path.relative_to(CHECKOUT))
        package = next((part for part in parts if part.startswith("stepbus")), "")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and not node.level:
                rows = [(node.module, tuple(alias.name for alias in node.names))]
            elif isinstance(node, ast.Import):
                rows = [(alias.name, ()) for alias in node.names]
            else:
                continue
            for module, names in rows:
                top = module.partition(".")[0]
                if top.startswith("stepbus") and top != package:
                    yield name, module, names


@pytest.mark.slow
def test_packages_import_from_no_private_module_of_others():
    private = {
        f"{file}: {module}"
        for file, module, _ in imports()
        if any(part.startswith("_") for part in module.split("."))
    }
    assert private == set()


def test_what_packages_import_is_exported():
    hidden = {
        f"{file}: {module}.{name}"
        for file, module, names in imports()
        for name in names
        if name != "*"  # exactly what is exported
        and name not in exported(module)
        and (name.startswith("_") or source_of(f"{module}.{name}") is None)
    }
    assert hidden == set()


def test_what_a_module_has_imported_or_keeps_to_itself_is_not_exported():
    names = exported("stepbus_orchestrator.run.kernel.admission")
    assert {"LOW_LATENCY_BYTES", "welcome_of"} <= names
    assert not names & {"Welcome", "hashlib", "_NO_LIMIT"}
