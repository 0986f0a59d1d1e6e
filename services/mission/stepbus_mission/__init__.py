"""The mission: references with exact derivatives, from a generator of your choice."""

from .references.params import Params

__all__ = ["Params"]
