"""What only loading a participant's models shows to be wrong, without a run."""

import importlib.util
import json
import subprocess

from stepbus_orchestrator.run.kernel.admission import welcome_of
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario, command, python_target
from stepbus_participant import Problems
from stepbus_schemas import encode

_CHECKS = {"stepbus_plant": ("stepbus_plant.check", "pybullet")}
"""Package of a participant → the module that makes it and says what is wrong; what that needs."""

_LONGEST_S = 120.0


def rehearse(scenario: Scenario, problems: Problems) -> None:
    """Let each plant load its world, and add what is wrong with it.

    One whose engine is not installed is left out: a run says so.
    """
    for spec in scenario.participants:
        launch, name = python_target(spec.exec[1:]) if spec.exec[:1] == ("python",) else ("", "")
        module, needs = _CHECKS.get(name, ("", "")) if launch == "module" else ("", "")
        if module and _is_installed(needs):
            _ask(scenario, spec, module, problems)


def _is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False


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
