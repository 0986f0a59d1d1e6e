"""The example that trains a policy."""

import shutil
import subprocess
import sys
from importlib.util import find_spec

import pytest
from support.paths import CHECKOUT

import stepbus


@pytest.mark.skipif(find_spec("cma") is None, reason="needs cma")
@pytest.mark.slow
@pytest.mark.usefixtures("starts_a_process")
def test_the_example_learns_and_records_a_test_of_its_policy(tmp_path):
    folder = shutil.copytree(CHECKOUT / "examples/gym_two_link", tmp_path / "example")
    (folder / "gains.json").unlink(missing_ok=True)
    done = subprocess.run(
        [sys.executable, "train.py", "--generations", "3"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=100,
        check=True,
    )
    best = [float(line.split()[3].rstrip(",")) for line in done.stdout.splitlines()[:3]]
    assert max(best[1:]) > best[0]
    assert (folder / "curve.png").stat().st_size > 10_000
    program = [sys.executable, "-m", "stepbus_gym.policy", "policy:Trained"]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        replayed = stepbus.replay("episodes/000001", "controller", program=program)
    assert replayed.equal
