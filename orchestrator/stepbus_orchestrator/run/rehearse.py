"""What only the classes of a scenario know to be wrong with it, before a run."""

import json
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from stepbus_orchestrator.run.folder import warnings_in
from stepbus_orchestrator.run.kernel.admission import misfits, welcome_of
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.program import PYTHON, missing
from stepbus_participant import Problems
from stepbus_participant.parameters import Keys
from stepbus_schemas import PROTOCOL_VERSION, Hello, encode

_LONGEST_S = 120.0


def rehearse(scenario: Scenario, problems: Problems, warnings: list[str] | None = None) -> None:
    """Have each class do what it does at the start of a run, and add what is wrong.

    warnings: gets those of the participants.

    All are asked at once, each in a process of its own: an engine may crash, and code of the user's
    may never return. Classes of ours are made, so that the plant loads its world and the controller
    its law; those of the user's are imported, and declare their ports and parameters.
    """
    with ExitStack() as stack:
        asked = []
        for spec in scenario.participants:
            lacking = missing(spec) if spec.is_here else ""
            if lacking:
                problems.add(("participants", spec.name), lacking)
            elif spec.participant and spec.is_here:
                asked.append((spec, stack.enter_context(_asked(scenario, spec))))
        for spec, process in asked:
            answer, printed = _answer(scenario, spec, process)
            for keys, text in answer:
                problems.add(("participants", spec.name, *keys), text)
            if warnings is not None:
                warnings += [f"{spec.name}: {text}" for text in warnings_in(printed)]


@contextmanager
def _asked(scenario: Scenario, spec: ParticipantSpec) -> Iterator[subprocess.Popen[bytes]]:
    """Start the process that knows a class; it is ended with the block."""
    with tempfile.TemporaryFile() as question:
        question.write(encode(welcome_of(scenario, spec, token="")))
        question.seek(0)
        process = subprocess.Popen(
            [*PYTHON, "-m", "stepbus_participant", "--rehearse", spec.participant],
            stdin=question,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=scenario.folder,
            start_new_session=True,
        )
    with process:
        try:
            yield process
        finally:
            process.kill()


def _answer(
    scenario: Scenario, spec: ParticipantSpec, process: subprocess.Popen[bytes]
) -> tuple[Sequence[tuple[Keys, str]], bytes]:
    """Return what a class says of itself, keys and a text each, and what it prints."""
    try:
        said, errors = process.communicate(timeout=_LONGEST_S)
        answer = json.loads(said)
    except subprocess.TimeoutExpired:
        return [(("participant",), f"{spec.participant} is not ready after {_LONGEST_S:g} s")], b""
    except ValueError:
        last = errors.decode(errors="replace").strip().rpartition("\n")[2]
        why = last or f"its process ends with exit code {process.returncode}"
        return [(("participant",), f"{spec.participant} cannot be checked: {why}")], errors
    found = [(tuple(keys), text) for keys, text in answer.pop("problems")]
    hello = Hello(protocol=PROTOCOL_VERSION, name=spec.name, token="", pid=0, **answer)
    return [*found, *misfits(hello, welcome_of(scenario, spec, token=""))], errors
