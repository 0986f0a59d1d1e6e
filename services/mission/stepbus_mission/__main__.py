"""Take part in a run as its mission."""

from stepbus_participant import main

from .references.participant import MissionParticipant

if __name__ == "__main__":
    raise SystemExit(main(MissionParticipant))
