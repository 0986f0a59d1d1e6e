"""Branch: the steps of a recording up to one, and from there a run with a change."""

from stepbus_orchestrator.replay.branch.branch import Branch, BranchPlan, Variant, branch, variants

__all__ = ["Branch", "BranchPlan", "Variant", "branch", "variants"]
