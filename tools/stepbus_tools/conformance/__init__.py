"""The conformance kit: plays orchestrator and peers to one participant, and checks what it does."""

from .outcome import CheckResult, Report, write_junit
from .play import CHECKS, conformance, select

__all__ = ["CHECKS", "CheckResult", "Report", "conformance", "select", "write_junit"]
