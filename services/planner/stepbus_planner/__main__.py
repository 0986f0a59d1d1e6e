"""Take part in a run as its planner."""

from stepbus import main

from .participant import PlannerParticipant

if __name__ == "__main__":
    raise SystemExit(main(PlannerParticipant))
