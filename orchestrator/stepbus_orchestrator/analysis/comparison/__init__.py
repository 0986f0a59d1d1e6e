"""Compares messages: equal to the byte, within a tolerance, or where they diverge."""

from .divergence import Divergence, PortResult, in_order, port_lines
from .port import PortComparison, fields_of
from .tolerance import (
    AnyTolerance,
    FieldTolerance,
    Tolerance,
    parse_tolerance,
    read_tolerance,
    tolerance_of,
)
from .values import differences, short

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
