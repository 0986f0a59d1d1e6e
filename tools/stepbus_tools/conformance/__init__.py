"""The conformance kit: plays orchestrator and peers to one participant, and checks what it does."""

from stepbus_tools.conformance.outcome import CheckResult, Report, write_junit

from .checks import CHECKS, select
from .execute import conformance

__all__ = ["CHECKS", "CheckResult", "Report", "conformance", "select", "write_junit"]
