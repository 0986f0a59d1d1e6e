"""The command `stepbus`."""

import sys

from stepbus_orchestrator.cli import main

if __name__ == "__main__":
    sys.exit(main())
