"""Moves an arm."""
