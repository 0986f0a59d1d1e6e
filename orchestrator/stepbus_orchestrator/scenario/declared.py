"""Check the parameters of every participant that declares them, without starting it.

They are the class `Params` (`stepbus.Settings`) of the module, or file, that `participant` names.
"""

import json
import subprocess
from collections.abc import Iterable, Sequence

from stepbus_participant import Problems, declared_parameters, extra_hint, is_ours
from stepbus_participant.parameters import Keys, find_problems

from .model import ParticipantSpec, Scenario
from .program import PYTHON

_LONGEST_S = 30.0


def check_params(scenario: Scenario, problems: Problems) -> None:
    """Add what is wrong with the parameters of participants.

    Modules of ours are imported here: with their parameters, they load nothing heavy. All others
    are the user's, and checked by `check_classes` where they have parameters.
    """
    others = []
    for spec in scenario.participants:
        keys: Keys = ("participants", spec.name)
        if not spec.participant or any(
            problems.has((*keys, key)) for key in ("participant", "params")
        ):
            continue
        source = spec.participant.rpartition(":")[0]
        if not is_ours(source):
            others.append(spec)
            continue
        try:
            declared = declared_parameters(source, scenario.folder)
        except ModuleNotFoundError as exc:
            text = f"{source} needs {exc.name}, which is not installed"
            problems.add(keys, text + extra_hint(exc.name or ""))
            continue
        if declared is not None:
            _add(problems, (*keys, "params"), find_problems(declared, spec.params, scenario.folder))
    check_classes(scenario, [spec for spec in others if spec.params], problems)


def check_classes(scenario: Scenario, specs: Sequence[ParticipantSpec], problems: Problems) -> None:
    """Import the classes of participants, in a process of its own, and add what is wrong.

    Code of the user's may never return, or end its process: it does neither to ours.
    """
    if not specs:
        return
    requests = [{"participant": s.participant, "params": dict(s.params)} for s in specs]
    try:
        done = subprocess.run(
            [*PYTHON, "-m", "stepbus_participant", "--check"],
            input=json.dumps(requests),
            capture_output=True,
            text=True,
            cwd=scenario.folder,
            timeout=_LONGEST_S,
            check=True,
            start_new_session=True,
        )
        answers = json.loads(done.stdout)
    except (OSError, subprocess.SubprocessError, ValueError) as exc:
        for spec in specs:
            text = f"{spec.participant} cannot be imported to check it: {exc}"
            problems.add(("participants", spec.name, "participant"), text)
        return
    for spec, found in zip(specs, answers, strict=True):
        _add(problems, ("participants", spec.name), [(tuple(k), text) for k, text in found])


def _add(problems: Problems, keys: Keys, found: Iterable[tuple[Keys, str]]) -> None:
    for below, message in found:
        problems.add((*keys, *below), message)
