"""Joints: commands, drives, sensors, warnings, and calls about them."""
