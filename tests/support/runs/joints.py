"""Runs small scenarios of our own participants with real processes, and finds what they leave."""

import textwrap
from pathlib import Path

import psutil
from support.paths import PROGRAMS

from stepbus_orchestrator.run.extension import Host
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load

PROGRAM = PROGRAMS / "joints.py"

SCENARIO = """
name: joints
step: 5ms
duration: 500ms
participants:
  plant:
    participant: joints.py:Plant
    step_timeout: 60s
    stop_timeout: 60s
    publishes: first
    inputs: {command: controller.command}
    outputs: {joint_state: JointState/1}
  controller:
    participant: joints.py:Controller
    step_timeout: 60s
    stop_timeout: 60s
    inputs: {joint_state: plant.joint_state, reference: mission.reference}
    outputs: {command: JointCommand/1}
  mission:
    participant: joints.py:Mission
    step_timeout: 60s
    stop_timeout: 60s
    every: 4
    outputs: {reference: JointReference/1}
"""


def write_scenario(folder: Path, text: str = SCENARIO) -> Path:
    """Write the scenario and its program into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "joints.py").write_bytes(PROGRAM.read_bytes())
    path = folder / "scenario.yaml"
    path.write_text(textwrap.dedent(text))
    return path


def run_joints(
    folder: Path,
    *overrides: str,
    observer: Observer | None = None,
    in_process: bool = False,
    host: Host | None = None,
    **options: object,
) -> Result:
    """Run the scenario with overrides; the run's folder is `folder/out`."""
    host = host or host_of(in_process=in_process)
    scenario = load(write_scenario(folder / "source"), overrides)
    return run(scenario, Options(out=folder / "out", host=host, **options), observer)


def fault(role: str, kind: str, step: int) -> str:
    """Return the override that lets a participant go wrong at a step."""
    return f"{role}.params={{fault: {kind}, at: {step}}}"


def leftovers(folder: Path) -> list[str]:
    """Return the command lines of all participants that still run, with their ticket or folder below `folder`."""
    found = []
    for process in psutil.process_iter():
        try:
            ticket = process.environ().get("STEPBUS_TICKET")
            below = any(
                Path(path).is_relative_to(folder) for path in (process.cwd(), ticket or "/")
            )
            if ticket and below and process.status() != psutil.STATUS_ZOMBIE:
                found.append(" ".join(process.cmdline()))
        except (psutil.NoSuchProcess, psutil.AccessDenied):
            continue
    return found
