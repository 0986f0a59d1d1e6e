"""Runs with a controller behind the bridge, and what they leave."""

from pathlib import Path

from support.runs.joints import PROGRAM, SCENARIO

from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

BRIDGED = PROGRAM.with_name("bridged.py")
SILENT = {"hang", "stop", "child"}
"""Kinds that a deadline finds."""
OWN = "participant: joints.py:Controller"


def write_bridged(folder: Path, form: str, kind: str = "right", step: int = 7) -> Path:
    """Write a scenario whose controller is bridged and does `kind` at a step."""
    assert OWN in SCENARIO
    folder.mkdir(parents=True, exist_ok=True)
    for program in (PROGRAM, BRIDGED):
        (folder / program.name).write_bytes(program.read_bytes())
    path = folder / "scenario.yaml"
    command = f"exec: [python, bridged.py, {form}, {kind}, '{step}']\n    bridge: {form}"
    path.write_text(SCENARIO.replace(OWN, command))
    return path


def run_bridged(
    folder: Path, form: str, kind: str = "right", step: int = 7, *more: str, **options: object
) -> Result:
    """Run it; the run's folder is `folder/out`."""
    hasty = ["controller.step_timeout=3s", "controller.stop_timeout=1s"]
    overrides = [*(hasty if kind in SILENT else []), *more]
    scenario = load(write_bridged(folder / "source", form, kind, step), overrides)
    return run(scenario, Options(out=folder / "out", **options))
