"""Faults from outside, judged by readers that use none of stepbus's code: `make campaign`."""
