"""Take part in a run: `python -m stepbus_store.motion.mobile`."""

from stepbus_participant import main

from .participant import MobileController

if __name__ == "__main__":
    raise SystemExit(main(MobileController))
