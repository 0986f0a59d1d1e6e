"""Every scenario that ships records the same bytes in one process as in separate ones."""

import pytest
from support.runs.patience import patient

from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.locate import builtin_names

STEPS = 60


def shortened(name):
    """Return a scenario that ships, for a few steps."""
    return load(name, patient(name, f"duration={STEPS * load(name).step_ns}ns"))


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", builtin_names())
def test_one_process_records_the_bytes_of_separate_ones(tmp_path, name):
    scenario = shortened(name)
    alone, separate = (
        run(scenario, Options(out=tmp_path / str(in_process), host=host_of(in_process=in_process)))
        for in_process in (True, False)
    )
    assert (alone.exit_code, separate.exit_code) == (0, 0), (alone.reason, separate.reason)
    assert alone.sha256 == separate.sha256
