"""The result of one check, and the report on all of them, as JUnit XML too."""

from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as ET

import msgspec

from stepbus_schemas import StepbusError, WiringError

Outcome = Literal["pass", "fail", "skipped"]


class Failed(StepbusError, AssertionError):
    """A participant did not do what the protocol demands; the text says what was observed."""


class Skipped(StepbusError):
    """A check does not apply to this participant, or cannot be judged; the text says why."""


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
