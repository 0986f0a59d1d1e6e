"""Tools over recordings and around runs: views, reports, exports, sweeps, checks.

They use the core, which does not know them: it finds them by entry points. Users import the same
from `stepbus`.
"""
