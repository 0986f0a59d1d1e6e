"""Take part in a run as its perception."""

from stepbus_participant import main

from .participant import PerceptionParticipant

if __name__ == "__main__":
    raise SystemExit(main(PerceptionParticipant))
