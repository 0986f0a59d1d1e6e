"""One map over another: how `extends` and templates combine."""

from collections.abc import Mapping
from typing import Any

from stepbus_participant.parameters import Keys

_PROGRAM = ("exec", "bridge")


def merged(base: dict[str, Any], top: dict[str, Any], at: Keys = ()) -> dict[str, Any]:
    """Return `base` with `top` over it: maps merged, the rest replaced, null removes.

    at: where both stand in a scenario; a participant is the class or the program of `top`.
    """
    is_row = len(at) == 2 and at[0] in {"participants", "templates"}
    result = without_replaced(base, top) if is_row else dict(base)
    for key, value in top.items():
        below = base.get(key)
        if value is None:
            result.pop(key, None)
        elif isinstance(value, dict):
            result[key] = merged(below if isinstance(below, dict) else {}, value, (*at, key))
        else:
            result[key] = value
    return result


def without_replaced(row: Mapping[str, Any], top: Mapping[str, Any]) -> dict[str, Any]:
    """Return a participant without its class or program, where `top` has the other."""
    has_class, has_program = (top.get(key) is not None for key in ("participant", "exec"))
    left_out = (*_PROGRAM * has_class, *("participant",) * has_program)
    return {key: value for key, value in row.items() if key not in left_out}
