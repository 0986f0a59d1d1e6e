"""Compares recordings."""
