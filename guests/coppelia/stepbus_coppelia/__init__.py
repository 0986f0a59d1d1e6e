"""Scripts for CoppeliaSim's remote API, new and old, take part in runs as they are.

Everything but the parameters is imported when it is first used.
"""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import GatewayParams as Params

if TYPE_CHECKING:
    from .gateway import Gateway

__all__ = ["Gateway", "Params"]

__getattr__ = imported_later(__name__, {"Gateway": "gateway"})
