"""The planner: finds collision-free paths of a robot's joints, timed within its limits."""

from typing import TYPE_CHECKING, Any

from .params import Params

if TYPE_CHECKING:
    from .participant import PlannerParticipant

__all__ = ["Params", "PlannerParticipant"]


def __getattr__(name: str) -> Any:
    # What plans loads Pinocchio and OMPL; the parameters can be checked without.
    if name == "PlannerParticipant":
        from .participant import PlannerParticipant  # noqa: PLC0415

        return PlannerParticipant
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
