"""Branch: the steps of a recording up to one, and from there a run with a change."""

from .branch import Branch, BranchPlan, branch
from .picture import draw_variants
from .vary import Variant, variants

__all__ = ["Branch", "BranchPlan", "Variant", "branch", "draw_variants", "variants"]
