"""The second part: sales of the store among posts, people, moved goods and failures."""

from .cases import Case, cases
from .judge import judge
from .run import Outcome, sell

__all__ = ["Case", "Outcome", "cases", "judge", "sell"]
