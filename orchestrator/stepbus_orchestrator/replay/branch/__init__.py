"""Branch: the steps of a recording up to one, and from there a run with a change."""

from .branch import Branch, BranchPlan, branch
from .vary import Variant, variants

__all__ = ["Branch", "BranchPlan", "Variant", "branch", "variants"]
