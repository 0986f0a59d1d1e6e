"""The child of a Python program that hosts participants, which watches its parent.

python watch_parent.py DESCRIPTOR PID
"""

import os
import signal
import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[3]))

from stepbus_orchestrator.run.inprocess.heartbeat import Heartbeat, Watcher


def _main(heartbeat: Heartbeat, pid: int) -> None:
    """Watch a process, which is not ours alone, until it ends us."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    # Another process may remove the folder in which it was started.
    os.chdir("/")
    watcher = Watcher(heartbeat, pid, is_owner=False)
    if watcher.await_end():
        sys.path[:] = heartbeat.will()["path"]
        from stepbus_orchestrator.run.inprocess.post_mortem import conclude  # noqa: PLC0415

        sys.stderr.write(conclude(heartbeat, pid, killer=watcher)[1])


if __name__ == "__main__":
    _main(Heartbeat(int(sys.argv[1])), int(sys.argv[2]))
