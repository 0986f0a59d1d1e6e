"""What only loading a participant's models shows to be wrong, without a run."""

import json
import subprocess

from stepbus_orchestrator.run.kernel.admission import welcome_of
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario, command, missing, python_target
from stepbus_participant import Problems
from stepbus_schemas import encode

_CHECKS = {"stepbus_plant": "stepbus_plant.check"}
"""Package of a participant → the module that makes it and says what is wrong."""

_LONGEST_S = 120.0


def rehearse(scenario: Scenario, problems: Problems) -> None:
    """Let each plant load its world, and add what is wrong with it, or is not installed."""
    for spec in scenario.participants:
        launch, name = python_target(spec.exec[1:]) if spec.exec[:1] == ("python",) else ("", "")
        module = _CHECKS.get(name, "") if launch == "module" else ""
        lacking = missing(spec)
        if lacking and not spec.is_external:
            problems.add(("participants", spec.name, "exec"), lacking)
        elif module and not lacking:
            _ask(scenario, spec, module, problems)


def _ask(scenario: Scenario, spec: ParticipantSpec, module: str, problems: Problems) -> None:
    where = ("participants", spec.name)
    try:
        done = subprocess.run(
            command(("python", "-m", module), scenario.folder),
            input=encode(welcome_of(scenario, spec, token="")),
            capture_output=True,
            timeout=_LONGEST_S,
            cwd=scenario.folder,
            check=True,
        )
    except subprocess.TimeoutExpired:
        problems.add(where, f"its world is not loaded after {_LONGEST_S:g} s")
    except OSError as exc:
        problems.add(where, f"its world cannot be loaded: {exc}")
    except subprocess.CalledProcessError as exc:
        last = exc.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        problems.add(where, f"its world cannot be loaded: {last or exc}")
    else:
        for keys, message in json.loads(done.stdout):
            problems.add((*where, *keys), message)
