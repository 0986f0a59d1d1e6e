"""Scenarios: what takes part in a run, how it is coupled, and whether that can work."""
