"""The page of a run that is going: what it records, and what a user can ask of it."""

from .page import LivePage, follow

__all__ = ["LivePage", "follow"]
