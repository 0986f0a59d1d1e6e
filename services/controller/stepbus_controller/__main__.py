"""Take part in a run as its controller."""

from stepbus_participant import main

from .participant import ControllerParticipant

if __name__ == "__main__":
    raise SystemExit(main(ControllerParticipant))
