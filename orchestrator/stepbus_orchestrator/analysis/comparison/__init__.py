"""Compares messages: equal to the byte, within a tolerance, or where they diverge."""
