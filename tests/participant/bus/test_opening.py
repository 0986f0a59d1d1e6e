"""Opening the bus leaves the environment of the process alone, for whoever reads it meanwhile."""

import json
import os
import subprocess
import sys

PROGRAM = """
import json, os, sys

changes = []
sys.addaudithook(
    lambda event, args: changes.append(event) if event in ("os.putenv", "os.unsetenv") else None
)
from stepbus_participant import Endpoint, ZenohBus

def threads():
    return len(os.listdir("/proc/self/task"))

before, counts = dict(os.environ), []
for number in range(3):
    bus = ZenohBus(Endpoint(listen=[f"unixsock-stream/{sys.argv[1]}/{number}"], connect=[]), "run")
    counts.append((len(changes), threads()))
    bus.close()
print(json.dumps([counts, dict(os.environ) == before]))
"""


def opened(folder, **more):
    environment = {name: value for name, value in os.environ.items() if name != "ZENOH_RUNTIME"}
    words = [sys.executable, "-c", PROGRAM, str(folder)]
    done = subprocess.run(
        words, env={**environment, **more}, capture_output=True, text=True, timeout=60, check=True
    )
    return json.loads(done.stdout)


def test_only_the_first_session_of_a_process_changes_its_environment_and_puts_it_back(tmp_path):
    # Its second thread is Zenoh's, which serves the later ones.
    assert opened(tmp_path) == [[[2, 2]] * 3, True]


def test_a_setting_of_the_user_stays(tmp_path):
    (first, *_), is_as_before = opened(tmp_path, ZENOH_RUNTIME="(app: (worker_threads: 2))")
    changes, threads = first
    assert (changes, is_as_before) == (0, True)
    assert threads > 2
