"""FMUs (Functional Mock-up Interface 2.0 and 3.0, co-simulation) take part in runs.

Everything but the parameters is imported when it is first used: FMPy takes 0.6 s.
"""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from .participant import Fmu

__all__ = ["Fmu", "Params"]

__getattr__ = imported_later(__name__, {"Fmu": "participant"})
