"""The plant as a process: `python -m stepbus_plant`."""

from stepbus_participant import main

from . import bullet as _bullet  # noqa: F401  (before all that imports PyBullet)
from .participant import PlantParticipant

if __name__ == "__main__":
    raise SystemExit(main(PlantParticipant))
