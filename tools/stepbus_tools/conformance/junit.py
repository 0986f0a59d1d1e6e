"""A report as JUnit XML, which CI servers show."""

from pathlib import Path
from xml.etree import ElementTree as ET

from stepbus_schemas import WiringError

from .outcome import CheckResult, Report


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
    suite.extend(_case(report, check) for check in report.checks)
    tree = ET.ElementTree(suite)
    ET.indent(tree)
    try:
        tree.write(path, encoding="utf-8", xml_declaration=True)
    except OSError as exc:
        raise WiringError(f"{path} cannot be written: {exc.strerror}") from exc


def _case(report: Report, check: CheckResult) -> ET.Element:
    case = ET.Element(
        "testcase",
        classname=f"stepbus.conformance.{report.participant}",
        name=f"{check.clause} {check.name}",
        time=f"{check.wall_s:.3f}",
    )
    seen = _printable(check.observed)
    if check.outcome == "fail":
        ET.SubElement(case, "failure", message=seen).text = check.summary
    elif check.outcome == "skipped":
        ET.SubElement(case, "skipped", message=seen)
    else:
        ET.SubElement(case, "system-out").text = seen
    return case


def _printable(text: str) -> str:
    """Return a text without the control characters that XML does not allow."""
    return "".join(char if char.isprintable() or char in "\n\t" else "�" for char in text)
