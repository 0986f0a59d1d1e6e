"""Plays orchestrator and peers to one participant, and checks what it does."""

import dataclasses
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from msgspec import structs

from stepbus_orchestrator.errors import Interrupted
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.program import command, replaced_program
from stepbus_participant import suggest
from stepbus_schemas import BridgeFormat, WiringError, error_text, raw_fields

from .checks import admission, encodings, endings, inputs, noise, steps
from .kit import Check, Kit
from .material import find, record
from .outcome import CheckResult, Failed, Outcome, Report, Skipped

CHECKS = tuple(
    item
    for module in (admission, steps, inputs, encodings, noise, endings)
    for item in vars(module).values()
    if isinstance(item, Check)
)
"""All checks, in the order they run."""


def select(names: Sequence[str]) -> tuple[Check, ...]:
    """Return the checks of these names, in the order they run; without names, all.

    Raises WiringError for an unknown name.
    """
    known = [check.name for check in CHECKS]
    for name in names:
        if name not in known:
            raise WiringError(f"no check {name!r}{suggest(name, known)}")
    return tuple(check for check in CHECKS if not names or check.name in names)


def conformance(
    scenario: Scenario,
    participant: str,
    program: Sequence[str] = (),
    *,
    bridge: BridgeFormat | None = None,
    checks: Sequence[Check] = CHECKS,
    logs: Path | None = None,
    on_result: Callable[[CheckResult], None] = lambda _result: None,
    interrupt: threading.Event | None = None,
) -> Report:
    """Play orchestrator and peers to one participant, and check what it does.

    program: its command line, started in the current folder; none: that of the scenario. bridge:
    the format that `stepbus bridge` speaks to it. logs: folder that keeps its logs, one folder for
    each start. on_result: called with each result.

    Raises WiringError when there is no such participant or program, RunFailure when its inputs
    cannot be recorded or it is interrupted.
    """
    own = find(scenario, participant)
    started = replaced_program(own, program, bridge)
    is_raw = started.bridge is not None and started.bridge.format == "raw"
    cwd = Path.cwd() if program else scenario.folder
    words = command(started.program, cwd)
    with tempfile.TemporaryDirectory(prefix="conformance-") as folder:
        prepared = _prepared(scenario, own, is_raw=is_raw)
        material = record(prepared, participant, Path(folder, "run"))
        kit = Kit(
            material=material,
            command=words,
            cwd=cwd,
            logs=logs or Path(folder, "logs"),
            interrupt=interrupt or threading.Event(),
            is_scenarios=started is own,
            knows_names=not is_raw,
            is_plain_checked=any(check.name == "steps" for check in checks),
        )
        results = run_checks(kit, checks, on_result)
    return Report(
        scenario=scenario.name,
        participant=participant,
        program=words,
        steps=material.steps,
        checks=results,
    )


def run_checks(
    kit: Kit, checks: Iterable[Check], on_result: Callable[[CheckResult], None]
) -> tuple[CheckResult, ...]:
    """Run checks one after the other; on_result: called with each result. Raises Interrupted."""
    results = []
    for each in checks:
        kit.check = each.name
        began = time.monotonic()
        outcome, observed = _outcome(kit, each)
        result = CheckResult(
            name=each.name,
            clause=each.clause,
            summary=each.summary,
            outcome=outcome,
            observed=observed,
            wall_s=time.monotonic() - began,
        )
        results.append(result)
        on_result(result)
    return tuple(results)


def _outcome(kit: Kit, each: Check) -> tuple[Outcome, str]:
    try:
        if each.inputs and not kit.spec.inputs:
            return "skipped", "it has no inputs"
        if each.plain:
            kit.reference()
        return "pass", each.run(kit)
    except Failed as exc:
        return "fail", str(exc)
    except Skipped as exc:
        return "skipped", str(exc)
    except Interrupted:
        raise
    except Exception as exc:  # noqa: BLE001  (the other checks still run)
        return "fail", f"the check itself failed: {error_text(exc)}"


def _prepared(scenario: Scenario, own: ParticipantSpec, *, is_raw: bool) -> Scenario:
    """Return the scenario without injected faults, and with the ports that the bridge carries."""
    outputs = own.outputs
    if is_raw:
        # Those that no participant reads are left out, as an author of a raw program does.
        read = {(i.source, i.port) for p in scenario.participants for i in p.inputs.values()}
        outputs = {
            port: output
            for port, output in outputs.items()
            if raw_fields(output.type, scenario.types) or (own.name, port) in read
        }
    specs = tuple(
        structs.replace(spec, on_fault="stop", outputs=outputs if spec is own else spec.outputs)
        for spec in scenario.participants
    )
    return dataclasses.replace(scenario, participants=specs, faults=())
