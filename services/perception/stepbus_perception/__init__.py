"""Perception: which items a camera sees, and where they are."""

from typing import TYPE_CHECKING, Any

from .params import Params

if TYPE_CHECKING:
    from .participant import PerceptionParticipant

__all__ = ["Params", "PerceptionParticipant"]


def __getattr__(name: str) -> Any:
    # What finds items loads Pinocchio and OpenCV; the parameters can be checked without.
    if name == "PerceptionParticipant":
        from .participant import PerceptionParticipant  # noqa: PLC0415

        return PerceptionParticipant
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
