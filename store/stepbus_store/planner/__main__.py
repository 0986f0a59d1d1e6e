"""Take part in a run as its planner."""

from stepbus_participant import main

from .participant import PlannerParticipant

if __name__ == "__main__":
    raise SystemExit(main(PlannerParticipant))
