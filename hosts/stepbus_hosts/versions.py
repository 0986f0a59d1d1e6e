"""What may differ between two hosts: protocol, message types, Python, libraries."""

import hashlib
import itertools
import platform
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from stepbus_participant import installed_version
from stepbus_schemas import MESSAGE_TYPES, PROTOCOL_VERSION

MUST_AGREE = ("protocol", "message types", "stepbus")
"""Where these differ, no step is done."""
_PACKAGES = ("stepbus", "eclipse-zenoh", "msgspec", "numpy", "pin", "pybullet", "mujoco", "ruckig")


def host_versions() -> dict[str, str]:
    """Return name → version of all that takes part in what a participant computes and sends.

    Of a package that is not there: nothing, as most participants need only some of them.
    """
    _, types = msgspec.json.schema_components(MESSAGE_TYPES.values())
    shapes = msgspec.json.encode(_without_help(types), order="sorted")
    return {
        "protocol": str(PROTOCOL_VERSION),
        "message types": hashlib.sha256(shapes).hexdigest()[:12],
        "python": platform.python_version(),
        "machine": platform.machine(),
        **{name: _version(name) for name in _PACKAGES},
    }


def _version(package: str) -> str:
    try:
        return installed_version(package)
    except ModuleNotFoundError:
        return ""


def _without_help(node: Any) -> Any:
    """Return a schema without its texts, which depend on the Python."""
    if isinstance(node, list):
        return [_without_help(one) for one in node]
    if not isinstance(node, dict):
        return node
    # A field may have that name.
    rows = ((k, v) for k, v in node.items() if k != "description" or isinstance(v, dict))
    return {key: _without_help(value) for key, value in rows}


def compared(table: Mapping[str, Mapping[str, str]]) -> Iterator[tuple[str, bool, str]]:
    """Yield (name, whether no two hosts have different versions, the versions in words).

    A participant that needs a package does not start where there is none: no result differs.

    table: host → what `host_versions` returns there.
    """
    for name in dict.fromkeys(itertools.chain(*table.values())):
        found = {host: row.get(name) or "none" for host, row in table.items()}
        seen = set(found.values())
        is_same = len(seen if name in MUST_AGREE else seen - {"none"}) <= 1
        words = ", ".join(map(" ".join, found.items()))
        yield name, is_same, f"{seen.pop()} everywhere" if len(seen) == 1 else words
