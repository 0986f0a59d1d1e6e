"""What only loading a participant's models shows to be wrong, without a run."""

import json
import subprocess

from stepbus_orchestrator.run.kernel.admission import welcome_of
from stepbus_orchestrator.scenario import (
    ParticipantSpec,
    Scenario,
    check_classes,
    command,
    missing,
)
from stepbus_participant import Problems, is_ours
from stepbus_schemas import encode

_CHECKS = {"stepbus_plant:Plant": "stepbus_plant.check"}
"""Participant → the module that makes it and says what is wrong."""

_LONGEST_S = 120.0


def rehearse(scenario: Scenario, problems: Problems) -> None:
    """Let each plant load its world, and add what is wrong with it, or is not installed.

    Classes of the user's whose parameters have shown nothing are imported, too.
    """
    own = [
        spec
        for spec in scenario.participants
        if spec.participant and not (spec.params or spec.is_external or is_ours(spec.participant))
    ]
    check_classes(scenario, own, problems)
    for spec in scenario.participants:
        module = _CHECKS.get(spec.participant, "")
        lacking = missing(spec)
        if lacking and not spec.is_external:
            problems.add(("participants", spec.name), lacking)
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
