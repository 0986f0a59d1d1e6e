"""Runs stepbus in simulated time, on a simulated host, with faults that a tape lists."""
