"""The conformance kit: plays orchestrator and peers to one participant, and checks what it does."""

from .play import CHECKS, CheckResult, Report, conformance, select, write_junit

__all__ = ["CHECKS", "CheckResult", "Report", "conformance", "select", "write_junit"]
