"""Perception: which items a camera sees, and where they are."""
