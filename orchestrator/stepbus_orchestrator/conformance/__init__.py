"""The conformance kit: plays orchestrator and peers to one participant, and checks what it does."""

from .catalogue import CHECKS, select
from .check import Check
from .execute import conformance
from .outcome import CheckResult, Report

__all__ = ["CHECKS", "Check", "CheckResult", "Report", "conformance", "select"]
