"""Take part in a run: `python -m stepbus_store.motion.arm`."""

from stepbus_participant import main

from .participant import ArmController

if __name__ == "__main__":
    raise SystemExit(main(ArmController))
