"""Opening the bus leaves the environment of the process alone, for whoever reads it meanwhile."""

import json
import os
import subprocess
import sys

PROGRAM = """
import json, os, sys, time
from pathlib import Path

changes = []
sys.addaudithook(
    lambda event, args: changes.append(event) if event in ("os.putenv", "os.unsetenv") else None
)
from stepbus_participant import Endpoint, ZenohBus

def threads():
    # One that ends may be gone before it is read; a new one has its name a little later.
    names = set()
    for path in Path("/proc/self/task").glob("*/comm"):
        try:
            names.add(path.read_text().strip())
        except OSError:
            continue
    return sorted(names & {f"{kind}-{n}" for kind in ("app", "acc", "net", "rx", "tx") for n in (0, 1)})

before, counts = dict(os.environ), []
for number in range(3):
    bus = ZenohBus(Endpoint(listen=[f"unixsock-stream/{sys.argv[1]}/{number}"], connect=[]), "run")
    counts.append(len(changes))
    give_up = time.monotonic() + 20
    while int(sys.argv[2]) > len(threads()) and time.monotonic() < give_up:
        time.sleep(0.01)
    bus.close()
print(json.dumps([counts, threads(), dict(os.environ) == before]))
"""


def opened(folder, threads, **more):
    """Open three sessions one after the other, and wait for that many threads of Zenoh."""
    environment = {name: value for name, value in os.environ.items() if name != "ZENOH_RUNTIME"}
    words = [sys.executable, "-c", PROGRAM, str(folder), str(threads)]
    done = subprocess.run(
        words, env={**environment, **more}, capture_output=True, text=True, timeout=120, check=True
    )
    return json.loads(done.stdout)


def test_only_the_first_session_of_a_process_changes_its_environment_and_puts_it_back(tmp_path):
    assert opened(tmp_path, 1) == [[2, 2, 2], ["app-0"], True]


def test_a_setting_of_the_user_stays(tmp_path):
    setting = "(rx: (handover: app), app: (worker_threads: 2))"
    counts, threads, is_as_before = opened(tmp_path, 2, ZENOH_RUNTIME=setting)
    assert (counts, is_as_before) == ([0, 0, 0], True)
    assert len(threads) >= 2
