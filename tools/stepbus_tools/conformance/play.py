"""All checks, how they run, and the report on them, as JUnit XML too."""

import dataclasses
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as ET

import msgspec
from msgspec import structs

from stepbus_orchestrator.errors import Interrupted
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.program import command, replaced_program
from stepbus_participant import suggest
from stepbus_schemas import BridgeFormat, WiringError, error_text, raw_fields

from .checks import admission, encodings, endings, inputs, noise, steps
from .kit import Check, Kit
from .material import find, record
from .transcript import Failed, Skipped

Outcome = Literal["pass", "fail", "skipped"]

CHECKS = tuple(
    item
    for module in (admission, steps, inputs, encodings, noise, endings)
    for item in vars(module).values()
    if isinstance(item, Check)
)
"""All checks, in the order they run."""


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one check.

    name, clause, summary: of the check. observed: one sentence. wall_s: how long it took [s].
    """

    name: str
    clause: str
    summary: str
    outcome: Outcome
    observed: str
    wall_s: float


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """The results of all checks.

    scenario, participant: whose ports were played. program: its command line. steps: length of
    the recorded inputs [steps].
    """

    scenario: str
    participant: str
    program: tuple[str, ...]
    steps: int
    checks: tuple[CheckResult, ...]

    def count(self, outcome: Outcome) -> int:
        """Return how many checks had an outcome."""
        return sum(check.outcome == outcome for check in self.checks)

    @property
    def conforms(self) -> bool:
        """Return whether no check failed."""
        return self.count("fail") == 0

    @property
    def wall_s(self) -> float:
        """Return how long all checks took [s]."""
        return sum(check.wall_s for check in self.checks)


def write_junit(report: Report, path: Path) -> None:
    """Write a report; each check is a test case. Raises WiringError when it cannot be written."""
    suite = ET.Element(
        "testsuite",
        name=f"stepbus conformance: {report.participant} of {report.scenario}",
        tests=str(len(report.checks)),
        failures=str(report.count("fail")),
        skipped=str(report.count("skipped")),
        errors="0",
        time=f"{report.wall_s:.3f}",
    )
    for check in report.checks:
        case = ET.SubElement(
            suite,
            "testcase",
            classname=f"stepbus.conformance.{report.participant}",
            name=f"{check.clause} {check.name}",
            time=f"{check.wall_s:.3f}",
        )
        # XML does not allow control characters.
        seen = "".join(c if c.isprintable() or c in "\n\t" else "�" for c in check.observed)
        if check.outcome == "fail":
            ET.SubElement(case, "failure", message=seen).text = check.summary
        elif check.outcome == "skipped":
            ET.SubElement(case, "skipped", message=seen)
        else:
            ET.SubElement(case, "system-out").text = seen
    tree = ET.ElementTree(suite)
    ET.indent(tree)
    try:
        tree.write(path, encoding="utf-8", xml_declaration=True)
    except OSError as exc:
        raise WiringError(f"{path} cannot be written: {exc.strerror}") from exc


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
