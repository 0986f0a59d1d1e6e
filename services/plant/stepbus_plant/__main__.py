"""Run the plant as a process."""

from __future__ import annotations

from stepbus import main

from .participant import PlantParticipant

if __name__ == "__main__":
    raise SystemExit(main(PlantParticipant))
