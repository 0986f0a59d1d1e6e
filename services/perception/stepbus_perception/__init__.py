"""Perception: which items a camera sees, and where they are."""

from .participant import PerceptionParticipant

__all__ = ["PerceptionParticipant"]
