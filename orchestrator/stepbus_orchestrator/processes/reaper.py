"""Ends what a killed orchestrator leaves behind: its children, and the run's private folder.

The orchestrator starts it as a separate process, with nothing but the standard library. It reads
`+<process group>` and `-<process group>` from its standard input; when that closes, however the
orchestrator ended, it kills the remaining groups and removes the folder.
"""

import contextlib
import os
import shutil
import signal
import sys


def watch(folder: str) -> None:
    """Keep the list until the orchestrator has ended, then clean up."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: list[int] = []
    for line in sys.stdin:
        group = int(line[1:])
        if line[0] == "+":
            groups.append(group)
        elif group in groups:
            groups.remove(group)
    for group in groups:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(group, signal.SIGKILL)
    shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    watch(sys.argv[1])
