"""The whole two-link run, again and again."""

import pytest

from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

pytestmark = pytest.mark.slow


def test_two_link_has_one_hash_in_every_window_and_over_every_transport(tmp_path):
    cases = [
        [],
        [],
        ["window=1", "batch=1"],
        ["window=64", "batch=32"],
        ["bus.transport=tcp"],
        ["bus.transport=tcp", "window=2", "batch=1"],
    ]
    results = [
        run(load("two_link", overrides), Options(out=tmp_path / str(number)))
        for number, overrides in enumerate(cases)
    ]
    assert [result.exit_code for result in results] == [0] * len(cases)
    assert len({result.sha256 for result in results}) == 1
    assert results[0].steps == 2000
