"""Sweeps: many runs of one scenario, on all cores or a cluster, and one table of them."""
