"""Moves a mobile base."""
