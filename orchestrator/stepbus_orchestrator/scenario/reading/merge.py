"""One map over another: how `extends` and templates combine."""

from typing import Any


def merged(base: dict[str, Any], top: dict[str, Any]) -> dict[str, Any]:
    """Return `base` with `top` over it: maps merged, the rest replaced, null removes."""
    result = dict(base)
    for key, value in top.items():
        below = base.get(key)
        if value is None:
            result.pop(key, None)
        elif isinstance(value, dict):
            result[key] = merged(below if isinstance(below, dict) else {}, value)
        else:
            result[key] = value
    return result
