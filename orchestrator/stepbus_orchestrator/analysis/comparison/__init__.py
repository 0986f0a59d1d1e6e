"""Compares messages: equal to the byte, within a tolerance, or where they diverge."""

from stepbus_orchestrator.analysis.comparison.divergence import (
    Divergence,
    PortComparison,
    PortResult,
    fields_of,
    in_order,
    port_lines,
)
from stepbus_orchestrator.analysis.comparison.tolerance import (
    AnyTolerance,
    FieldTolerance,
    Tolerance,
    differences,
    parse_tolerance,
    read_tolerance,
    short,
    tolerance_of,
)

__all__ = [
    "AnyTolerance",
    "Divergence",
    "FieldTolerance",
    "PortComparison",
    "PortResult",
    "Tolerance",
    "differences",
    "fields_of",
    "in_order",
    "parse_tolerance",
    "port_lines",
    "read_tolerance",
    "short",
    "tolerance_of",
]
