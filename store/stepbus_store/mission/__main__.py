"""Take part in a run as the mission of a store."""

from stepbus_participant import main

from .participant import StoreMission

if __name__ == "__main__":
    raise SystemExit(main(StoreMission))
