"""Every scenario that ships records the same bytes in one process as in separate ones."""

from pathlib import Path

import pytest
from support.runs.store import has_robots

import stepbus_scenarios
from stepbus_orchestrator import Options, load
from stepbus_orchestrator.run.run_scenario import run
from stepbus_schemas import WiringError

ROOT = Path(stepbus_scenarios.__file__).parent
NAMES = sorted(
    str(path.parent.relative_to(ROOT) if path.name == "scenario.yaml" else path.relative_to(ROOT).with_suffix(""))
    for path in ROOT.rglob("*.yaml")
)  # fmt: skip
STEPS = 60


def shortened(name):
    """Return a scenario that ships, for a few steps; None for a file of another purpose."""
    try:
        scenario = load(name)
    except WiringError:
        return None
    patient = [f"{spec.name}.spawn_timeout=120s" for spec in scenario.participants]
    return load(name, [*patient, f"duration={STEPS * scenario.step_ns}ns"])


@pytest.mark.slow
@pytest.mark.skipif(not has_robots(), reason="example-robot-data is not installed")
@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", NAMES)
def test_one_process_records_the_bytes_of_separate_ones(tmp_path, name):
    scenario = shortened(name)
    if scenario is None:
        pytest.skip("no scenario")
    alone, separate = (
        run(scenario, Options(out=tmp_path / str(in_process), in_process=in_process))
        for in_process in (True, False)
    )
    assert (alone.exit_code, separate.exit_code) == (0, 0), (alone.reason, separate.reason)
    assert alone.sha256 == separate.sha256
