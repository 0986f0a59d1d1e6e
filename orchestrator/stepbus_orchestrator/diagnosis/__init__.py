"""Checks of what takes part and where: a program, a plant, this machine."""
