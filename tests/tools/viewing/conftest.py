"""What several tests of views share."""

import pytest

from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


@pytest.fixture(scope="session")
def plain_run(tmp_path_factory):
    """A run of `Paused` that nobody looks at."""
    out = tmp_path_factory.mktemp("plain") / "run"
    return run(load("two_link", ["duration=1s"]), Options(out=out, host=InProcess()))


@pytest.fixture(scope="session")
def plain(plain_run):
    """The hash of a run of `Paused` that nobody looks at."""
    return plain_run.sha256
