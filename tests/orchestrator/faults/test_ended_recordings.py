"""Runs that a full disk, a limit of the file size or kill -9 has ended: what is there is a test.

The recording is judged by the mcap package, and by the replay of each participant.
"""

import random
import resource
import shutil
import subprocess
import sys
import time
from collections import Counter

import psutil
import pytest
from mcap.reader import make_reader
from support.surroundings import comes_true, has_ended

from stepbus_orchestrator.recording import Recording, recover
from stepbus_orchestrator.replay import replay

COMMAND = [sys.executable, "-m", "stepbus_orchestrator.cli", "run", "two_link", "--no-report"]
CONTROLLED = ["--in-process", "--set", "duration=1000s"]


def end_by_kill(folder, chance):
    """Kill a run when its recording has grown to some size; return its folder."""
    size = chance.randrange(30_000, 900_000)
    with subprocess.Popen(
        [*COMMAND, *CONTROLLED, "--out", folder], stdout=subprocess.DEVNULL
    ) as process:
        recording = folder / "run.mcap"
        give_up = time.monotonic() + 60
        while not recording.exists() or recording.stat().st_size < size:
            assert process.poll() is None
            assert time.monotonic() < give_up
            time.sleep(0.001)
        # It watches the one that writes, which ends with it.
        family = [psutil.Process(process.pid), *psutil.Process(process.pid).children()]
        process.kill()
        assert comes_true(lambda: all(has_ended(one) for one in family))


def end_by_limit(folder, chance):
    """Let no file of a run grow over some size."""
    # The room that is set aside for the index takes 512 KiB.
    size = chance.randrange(600_000, 1_500_000)

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    words = [*COMMAND, *CONTROLLED, "--out", folder]
    done = subprocess.run(words, preexec_fn=limit, capture_output=True, check=False)
    assert done.returncode == 8


def judge(folder, scratch):
    """Assert that a recording ends with a whole step, recovered too, and that replays are equal."""
    recovery = recover(folder / "run.mcap", scratch / "fixed.mcap")
    with recovery.target.open("rb") as stream:
        found = make_reader(stream, validate_crcs=True).iter_messages()
        counted = Counter(channel.topic for _, channel, _ in found)
    counted.pop("stepbus/chain")
    assert set(counted.values()) == {recovery.last_step + 1}
    assert len(counted) == 4
    with Recording(folder / "run.mcap") as recording:
        assert recording.last_step == recovery.last_step > 0
    for name in ("plant", "controller", "mission"):
        for recorded in (folder / "run.mcap", recovery.target):
            result = replay(recorded, name)
            assert result.equal, (name, recorded, result.text())
    return recovery


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("end", [end_by_kill, end_by_limit])
def test_what_a_run_leaves_that_was_ended_is_whole_and_can_be_replayed(tmp_path, end, seed):
    end(tmp_path / "run", random.Random(seed))
    judge(tmp_path / "run", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_what_a_full_disk_has_ended_is_whole_and_can_be_replayed(tmp_path, small_disk, seed):
    disk = small_disk(f"{random.Random(seed).randrange(1300, 2600)}k")
    words = [*COMMAND, *CONTROLLED, "--out", disk / "run"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 8
    judge(shutil.copytree(disk / "run", tmp_path / "run"), tmp_path)
