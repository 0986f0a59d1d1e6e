"""What may differ between two hosts: protocol, message types, Python, libraries."""

import hashlib
import platform

import msgspec

from stepbus_participant import installed_version
from stepbus_schemas import PROTOCOL_VERSION, SHIPPED

MUST_AGREE = ("protocol", "message types", "stepbus")
"""Where these differ, no step is done."""
_PACKAGES = ("stepbus", "eclipse-zenoh", "msgspec", "numpy", "pin", "pybullet", "mujoco", "ruckig")


def host_versions() -> dict[str, str]:
    """Return name → version of all that takes part in what a participant computes and sends."""
    types = msgspec.json.encode(SHIPPED.only(SHIPPED.declarations).declarations, order="sorted")
    return {
        "protocol": str(PROTOCOL_VERSION),
        "message types": hashlib.sha256(types).hexdigest()[:12],
        "python": platform.python_version(),
        "machine": platform.machine(),
        **{name: installed_version(name) for name in _PACKAGES},
    }
