"""`stepbus selftest`: a known angle on every joint of a plant in turn, and what comes of it."""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

if TYPE_CHECKING:
    from .judge import Verdict
    from .run_selftest import SelfTest, selftest

_MODULES = {"SelfTest": "run_selftest", "Verdict": "judge", "selftest": "run_selftest"}

__all__ = ["SelfTest", "Verdict", "selftest"]

__getattr__ = imported_later(__name__, _MODULES)
