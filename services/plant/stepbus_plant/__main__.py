"""The plant as a process: `python -m stepbus_plant`."""

from stepbus_participant import main

from .participant import PlantParticipant

if __name__ == "__main__":
    raise SystemExit(main(PlantParticipant))
