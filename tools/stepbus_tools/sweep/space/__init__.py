"""Which runs a sweep makes: axes, their product and draws, or an optimizer's choice."""

from .axes import FAULTS, Axis, Span, parse_axis
from .design import SAMPLINGS, Design, Point
from .distributions import Distribution

__all__ = ["FAULTS", "SAMPLINGS", "Axis", "Design", "Distribution", "Point", "Span", "parse_axis"]
