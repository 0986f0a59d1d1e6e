"""Take part in a run: `python -m stepbus_controller.position`."""

from stepbus_participant import main

from .participant import PositionController

if __name__ == "__main__":
    raise SystemExit(main(PositionController))
