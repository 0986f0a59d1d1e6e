"""What a module or package offers to others, as its source says."""

import ast
from functools import cache
from importlib.util import find_spec
from pathlib import Path


@cache
def source_of(module):
    """Return the path of a module's source, or None where there is none; nothing is imported."""
    top, *below = module.split(".")
    spec = find_spec(top)
    path = Path(spec.submodule_search_locations[0], *below)
    files = (path / "__init__.py", path.with_name(f"{path.name}.py"))
    return next((file for file in files if file.is_file()), None)


@cache
def exported(module):
    """Return `__all__`; without one, what a module defines in the open, or passes on.

    A package passes on what `from .part import *` and `import name as name` take, and what it
    imports later.
    """
    statements = ast.parse(source_of(module).read_text(encoding="utf-8")).body
    imports = [node for node in statements if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: f"{node.module}.{alias.name}" for node in imports for alias in node.names}
    listed = {"__all__": set(), "_LATER": set()}
    names = set()
    for node in statements:
        targets = getattr(node, "targets", None) or [getattr(node, "target", node)]
        given = {getattr(target, "id", getattr(target, "name", "_")) for target in targets}
        for name in given & set(listed):
            listed[name] |= _strings(node.value, homes)
        names |= given
    for node in imports:
        names |= {alias.asname for alias in node.names if alias.asname == alias.name}
        if node.names[0].name == "*":
            names |= exported(f"{module}.{node.module}" if node.level else node.module)
    if "__all__" in names:
        return listed["__all__"]
    return {name for name in names | listed["_LATER"] if not name.startswith("_")}


def _strings(value, homes):
    """Return the names of a list, of a dictionary's keys, or of what another module lists."""
    if isinstance(value, ast.Dict):
        return {key.value for key in value.keys}
    if isinstance(value, ast.Call):
        return _strings(value.args[0], homes)
    if isinstance(value, ast.Attribute):
        return exported(homes[value.value.id])
    return {item.value for item in value.elts}
