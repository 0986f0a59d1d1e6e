"""The phases of a run, each in a file of its own, and the machine that goes through them."""

from .machine import run_phases

__all__ = ["run_phases"]
