"""Tests use what users can use: no test reaches for a private name of an object."""

import ast

from support.paths import TESTS

THEIRS = {"_replace", "_asdict", "_fields", "_exit"}
"""Names with an underscore that are public all the same: of named tuples, and os._exit."""

PATCHING = {"eye.py"}
"""Programs that are wrong on purpose: they replace methods of their own library."""


def private_accesses(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute) or not node.attr.startswith("_"):
            continue
        is_own = isinstance(node.value, ast.Name) and node.value.id in {"self", "cls"}
        if not is_own and not node.attr.startswith("__") and node.attr not in THEIRS:
            yield f"{path.relative_to(TESTS)}:{node.lineno}: {node.attr}"


def test_no_test_reaches_for_a_private_name():
    paths = [path for path in sorted(TESTS.rglob("*.py")) if path.name not in PATCHING]
    found = [text for path in paths for text in private_accesses(path)]
    assert found == []
