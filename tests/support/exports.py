"""What a module or package offers to others."""

import ast
import importlib
from pathlib import Path


def exported(module):
    """Return `__all__`; without one, what a module defines in the open, or passes on.

    A package passes on what `from .part import *` and `import name as name` take, and what it
    imports later.
    """
    loaded = importlib.import_module(module)
    if hasattr(loaded, "__all__"):
        return set(loaded.__all__)
    names = set(getattr(loaded, "_LATER", ()))
    for node in ast.parse(Path(loaded.__file__).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            names |= {alias.asname for alias in node.names if alias.asname == alias.name}
            if node.names[0].name == "*":
                names |= exported(f"{module}.{node.module}" if node.level else node.module)
        else:
            targets = getattr(node, "targets", None) or [getattr(node, "target", node)]
            names |= {getattr(target, "id", getattr(target, "name", "_")) for target in targets}
    return {name for name in names if not name.startswith("_")}
