"""The conformance kit: plays orchestrator and peers to one participant, and checks what it does."""

from .checks import CHECKS, select
from .execute import conformance
from .outcome import CheckResult, Report

__all__ = ["CHECKS", "CheckResult", "Report", "conformance", "select"]
