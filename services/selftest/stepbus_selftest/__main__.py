"""The tester as a process: `python -m stepbus_selftest`."""

from stepbus_participant import main

from .tester import Tester

if __name__ == "__main__":
    raise SystemExit(main(Tester))
