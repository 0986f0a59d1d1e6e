"""Take part in a run as its world model."""

from stepbus_participant import main

from .participant import WorldModelParticipant

if __name__ == "__main__":
    raise SystemExit(main(WorldModelParticipant))
