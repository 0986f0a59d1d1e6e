"""Without the extra `robots`, every test file is collected or left out: `make test` works."""

import json
import subprocess
import sys

from support.paths import CHECKOUT

# What the extra installs is not found: neither its modules, nor the models of its packages.
WITHOUT = """
import sys
for name in ("cv2", "eaik", "ompl", "toppra", "xacro"):
    sys.modules[name] = None
import stepbus_participant.files.paths as paths
def missing(url):
    if "example-robot-data" in url or "baxter" in url:
        raise paths.WiringError(url + ": not installed here")
    return package_path(url)
package_path, paths.package_path = paths.package_path, missing
import stepbus_participant
stepbus_participant.package_path = missing
import pytest
raise SystemExit(pytest.main(["--collect-only", "-q", "-p", "no:cacheprovider", "tests"]))
"""


def test_all_tests_are_collected_without_the_extra():
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT],
        check=False,
        cwd=CHECKOUT,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.returncode == 0, json.dumps(done.stdout[-3000:])
    assert "files of tests that need the extra robots" in done.stdout
