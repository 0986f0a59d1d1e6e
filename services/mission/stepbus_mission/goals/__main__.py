"""Take part in a run as a mission that sends goals one after the other."""

from stepbus_participant import main

from .participant import GoalSequence

if __name__ == "__main__":
    raise SystemExit(main(GoalSequence))
