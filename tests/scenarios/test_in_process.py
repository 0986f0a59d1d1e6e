"""Every scenario that ships records the same bytes in one process as in separate ones."""

import pytest

from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.locate import builtin_names

STEPS = 60


def shortened(name):
    """Return a scenario that ships, for a few steps."""
    scenario = load(name)
    patient = [f"{spec.name}.spawn_timeout=120s" for spec in scenario.participants]
    return load(name, [*patient, f"duration={STEPS * scenario.step_ns}ns"])


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
