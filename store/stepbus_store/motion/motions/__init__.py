"""Motions of joints over time: within limits, fitted to motors, slowed down, stopped."""
