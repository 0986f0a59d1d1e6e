"""Where two recordings part, in words: the signal by its name, its values by few digits."""

import re
from collections.abc import Sequence

from stepbus_orchestrator.analysis.divergence import Divergence
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import StepbusError
from stepbus_tools.columns import fields_of
from stepbus_tools.report.units import engineering, told_apart

_ELEMENT = re.compile(r"(\w+)(?:\[(\d+)\])?")


def divergence_text(divergence: Divergence, recording: Recording, runs: Sequence[str]) -> str:
    """Return the first divergence of a recording from another one. runs: names of both."""
    one, other = runs
    first, second = divergence.first, divergence.second
    match divergence.type:
        case "missing" | "added":
            only = one if divergence.type == "missing" else other
            what = f"{divergence.topic}: only {only} has a message"
        case "value" if isinstance(first, float) and isinstance(second, float):
            name, unit = _signal(divergence, recording)
            shown, beside = told_apart(first, second, unit)
            gap = engineering(abs(first - second), unit)
            what = f"{name}: {one} {shown}, {other} {beside} (difference {gap})"
        case _:
            what = divergence.detail(one, other)
    return f"first at step {divergence.step}: {what}"


def _signal(divergence: Divergence, recording: Recording) -> tuple[str, str]:
    """Return what has diverged, such as `controller/command values.joint1`, and its unit."""
    name, unit, port = divergence.field, "", recording.ports[divergence.topic]
    if element := _ELEMENT.fullmatch(divergence.field):
        try:
            fields = {field.name: field for field in fields_of(port, port.message_class)}
        except StepbusError:
            fields = {}
        if field := fields.get(element[1]):
            column = field.columns[int(element[2] or 0) if field.is_flat else 0]
            # One of several units, by the mode of a command, is none.
            unit = "" if "," in column.unit else column.unit
            name = column.name if field.is_flat else name
    return f"{divergence.topic} {name}", unit
