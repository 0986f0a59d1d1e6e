"""`stepbus selftest`: a known angle on every joint of a plant in turn, and what comes of it."""

from .judge import Verdict
from .run_selftest import SelfTest, selftest

__all__ = ["SelfTest", "Verdict", "selftest"]
