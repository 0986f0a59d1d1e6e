"""Without the extra `robots`, every test file is collected or left out: `make test` works."""

import re
import subprocess
import sys

import pytest
from support.paths import CHECKOUT

# What the extra installs is not found: neither its modules, nor the models of its packages.
WITHOUT = """
import sys
for name in ("cv2", "eaik", "ompl", "toppra", "xacro"):
    sys.modules[name] = None
import stepbus_participant.files.paths as paths
def missing(url, folder=None):
    if "example-robot-data" in url or "baxter" in url:
        raise paths.WiringError(url + ": not installed here; pip install 'stepbus[robots]'")
    return package_path(url, folder)
package_path, paths.package_path = paths.package_path, missing
import stepbus_participant
stepbus_participant.package_path = missing
import pytest
raise SystemExit(pytest.main(["-q", "-rs", "-p", "no:cacheprovider", *sys.argv[1:]]))
"""


def run_without(*words):
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, *words],
        check=False, cwd=CHECKOUT, capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:]
    return done.stdout


@pytest.mark.slow
def test_all_tests_are_collected_without_the_extra():
    output = run_without("--collect-only", "tests")
    assert "files of tests that need the extra robots" in output


def test_scenarios_that_need_the_extra_are_skipped_without_it():
    files = ("tests/docs/test_scenario.py", "tests/orchestrator/scenario/test_describe.py")
    found = run_without(*files, "-k", "round_trip or no_path")
    assert re.search(r"SKIPPED \[4\] .*needs the extra robots", found), found
