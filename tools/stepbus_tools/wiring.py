"""The wiring of a scenario as a picture: text for Mermaid, or an SVG that Graphviz draws."""

import json
import re
import subprocess
from collections.abc import Mapping, Sequence
from html import escape
from importlib.metadata import PackageNotFoundError, files
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

from msgspec import structs

from stepbus_orchestrator.recording import Descriptions, Recording, Tail
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario, ScenarioFile
from stepbus_orchestrator.scenario.schedule import sort
from stepbus_participant import ExtraMissing, lacks
from stepbus_participant.parameters import Problems, read
from stepbus_schemas import SHIPPED, Description, StepbusError, Types, WiringError, json_schema
from stepbus_tools.theme import NIGHT, PAPER
from stepbus_tools.whole_file import replaced

_PROGRAM = "graphviz-pure"
_DRAW_S, _MOST_PORTS, _MOST_UNITS = 10.0, 500, 4
_NOTE = "Numbers: order within a step. Outputs are recorded unless marked."


def draw_wiring(
    scenario: Scenario | Mapping[str, Any], descriptions: Descriptions, target: Path | None = None
) -> str:
    """Return the wiring of a scenario as Mermaid; or write it to a file, and say so.

    scenario: or its plain data. descriptions: participant → output → its own. target: `.svg`: SVG.
    Raises WiringError, ExtraMissing without Graphviz, RecordingFailed where it cannot be written.
    """
    if isinstance(scenario, Scenario):
        nodes = _nodes(scenario.step_ns, scenario.participants, scenario.types, descriptions)
    else:
        nodes = _nodes(*_unchecked(scenario), SHIPPED, descriptions)
    if target is None:
        return _mermaid(nodes)
    if target.suffix.lower() in {".png", ".pdf", ".jpg", ".jpeg"}:
        raise WiringError(f"{target}: the picture is an SVG: {target.with_suffix('.svg')}")
    text = f"{_mermaid(nodes)}\n"
    if target.suffix.lower() == ".svg":
        day, night = ("svg{{color:{ink};background:{paper}}}".format(**c) for c in (PAPER, NIGHT))
        style = f"<style>{day}@media (prefers-color-scheme:dark){{{night}}}</style>"
        text = _svg(nodes).replace(">", f">{style}", 1)
    with replaced(target) as part:
        part.write_text(text, encoding="utf-8")
    return f"wrote {target}"


def recorded_wiring(recording: Recording | Tail) -> str:
    """Return the wiring of a recording for a page, folded; nothing that it names is loaded."""
    if not recording.scenario:
        return ""
    own = dict[str, dict[str, Description]]()
    for port in recording.ports.values():
        own.setdefault(port.participant, {})[port.name] = port.description
    try:
        shown = _svg(_nodes(*_unchecked(recording.scenario), recording.types, own))
    except StepbusError as exc:
        shown = f"<p>It cannot be drawn: {escape(str(exc))}</p>"
    inner = f'<div class="wiring" tabindex="0">{shown}</div>'
    return f"<details><summary>Wiring: participants, ports, rates</summary>{inner}</details>"


def _unchecked(data: Mapping[str, Any]) -> tuple[int, list[ParticipantSpec]]:
    """Return the step [ns] and participants of plain data; raises SettingsError."""
    problems = Problems()
    row = read(ScenarioFile, data, problems)
    problems.refuse()
    rows = row.participants.items()
    return row.step_ns, [ParticipantSpec(name=name, **structs.asdict(one)) for name, one in rows]


class _Node(NamedTuple):
    """A participant. ports: name, type of an output, what else is said of it.

    reads: number of a participant → whether all that it reads of that is of earlier steps.
    """

    title: str
    rate: str
    inputs: list[tuple[str, str, str]]
    outputs: list[tuple[str, str, str]]
    reads: dict[int, bool]


def _nodes(
    step_ns: int, specs: Sequence[ParticipantSpec], types: Types, descriptions: Descriptions
) -> list[_Node]:
    """Return the participants in the order within a step; raises WiringError if too many."""
    if sum(len(spec.inputs) + len(spec.outputs) + 1 for spec in specs) > _MOST_PORTS:
        raise WiringError(f"more than {_MOST_PORTS} ports are too many for a picture")
    nodes, order, by_name = list[_Node](), sort(specs)[0], {spec.name: spec for spec in specs}
    for name in order:
        spec, own = by_name[name], descriptions.get(name, {})
        steps = f" ({spec.every} steps)" if spec.every > 1 else ""
        first = ", publishes first" if spec.publishes == "first" else ""
        rate = f"every {spec.every * step_ns * 1e-6:g} ms{steps}{first}"
        node = _Node(f"{len(nodes) + 1} · {name}", rate, [], [], {})
        for port, item in spec.inputs.items():
            age = f", {item.delay} step{'s' * (item.delay > 1)} old" if item.delay else ""
            node.inputs.append((port, "", f"from {item.from_}{age}"))
            if item.source in by_name:
                source = order.index(item.source)
                node.reads[source] = node.reads.get(source, True) and item.delay > 0
        for port, output in spec.outputs.items():
            kept = {"all": "", "off": "; not recorded"}
            units = _units(output.type, types, own.get(port, Description()).units)
            facts = units + kept.get(output.record, f"; recorded {output.record}")
            node.outputs.append((port, output.type, facts.removeprefix("; ")))
        nodes.append(node)
    return nodes


def _units(name: str, types: Types, own: Mapping[str, str]) -> str:
    """Return the units of a message type. own: field → unit where an output has another."""
    schema = json_schema(name, types) if name in types else {}
    fields = schema.get("properties", {}) | {field: {"unit": unit} for field, unit in own.items()}
    told = json.dumps([fields, schema.get("$defs")], ensure_ascii=False)
    texts = ", ".join(re.findall('"unit": "([^"]+)"', told)).split(", ")
    units = [text for text in dict.fromkeys(texts) if text not in {"", "-"}]
    return ", ".join(units[:_MOST_UNITS]) + ", …" * (len(units) > _MOST_UNITS)


def _mermaid(nodes: list[_Node]) -> str:
    lines = ['%%{init: {"flowchart": {"wrappingWidth": 500}}}%%', "flowchart TD", f"  %% {_NOTE}"]
    arrows = list[str]()
    for number, (title, rate, inputs, outputs, reads) in enumerate(nodes):
        rows = [title, rate, *(f"◂ {port} {text}" for port, _, text in inputs)]
        rows += [f"▸ {port}: {form}{facts and f' ({facts})'}" for port, form, facts in outputs]
        lines.append(f'  p{number}["{"<br/>".join(map(_entities, rows))}"]')
        arrows += [f"  p{a} {'-.->' if old else '-->'} p{number}" for a, old in reads.items()]
    return "\n".join([*lines, *arrows])


def _entities(text: str) -> str:
    """Return a text without what means anything to Mermaid, HTML or Markdown."""
    other = r"[^\w ./:,;·◂▸²()…-]|__+"
    return re.sub(other, lambda match: "".join(f"#{ord(c)};" for c in match[0]), text)


_SIZES = {"14.00": "12", "12.00": "10"}
"""Of fonts, laid out → shown: those of machines without Helvetica are up to a sixth wider."""
_HEAD = f"""digraph {{
bgcolor=transparent nodesep=0.3 ranksep=0.45 fontname=Helvetica fontsize=12 label="{_NOTE}"
node [shape=plain fontname=Helvetica color="#000000" fontcolor="#000000"]
edge [color="#000000c0" arrowsize=0.7]
"""


def _svg(nodes: list[_Node]) -> str:
    """Return an SVG in the colour of the text around it; raises as `draw_wiring`."""
    lines = [f"p{number} [label=<{_table(node)}>]" for number, node in enumerate(nodes)]
    for to, node in enumerate(nodes):
        for source, is_old in node.reads.items():
            # What is read against the order within a step moves no participant.
            ahead, style = str(source < to).lower(), "dashed" if is_old else "solid"
            lines.append(f"p{source} -> p{to} [constraint={ahead} style={style}]")
    # A chain is narrow from top to bottom, many readers of one source from left to right.
    ways = (_drawn("\n".join([_HEAD, f"rankdir={way}", *lines, "}"])) for way in ("TB", "LR"))
    text = min(ways, key=lambda text: int(text.split('width="')[1].split("pt")[0]))
    text = re.sub(r'(?s)<title>.*?</title>\n|<!--.*?-->\n|^.*?(?=<svg)| (id|class)="\w+"', "", text)
    text = re.sub(r'font-size="([\d.]+)"', lambda size: f'font-size="{_SIZES[size[1]]}"', text)
    text = re.sub(r'="(\d+)pt"', r'="\1"', text, count=2).replace("#000000", "currentColor")
    return text.replace("<svg", '<svg role="img" aria-label="wiring" fill="currentColor"', 1)


def _drawn(dot: str) -> str:
    try:
        (program,) = (file.locate() for file in files(_PROGRAM) or () if file.name == _PROGRAM)
    except (PackageNotFoundError, ValueError) as exc:
        raise ExtraMissing(lacks("the picture of the wiring", _PROGRAM)) from exc
    words, given = [str(program), "-Tsvg"], dot.encode(errors="replace")
    try:
        done = subprocess.run(words, input=given, capture_output=True, timeout=_DRAW_S, check=True)
    except (OSError, subprocess.SubprocessError) as exc:
        raise WiringError(f"{_PROGRAM} could not draw the wiring: {exc}") from exc
    return done.stdout.decode()


def _table(node: _Node) -> str:
    """Return a participant: inputs on the left, outputs on the right."""
    pairs = zip_longest(node.inputs, node.outputs, fillvalue=("", "", ""))
    rows = "".join(f"<TR>{_cell(*one)}{_cell(*other)}</TR>" for one, other in pairs)
    head = f"<B>{escape(node.title)}</B><BR/>{_soft(node.rate)}"
    return (
        '<TABLE BORDER="1" CELLBORDER="0" CELLSPACING="0" CELLPADDING="4" STYLE="ROUNDED">'
        f'<TR><TD COLSPAN="2" BGCOLOR="#00000014">{head}</TD></TR>{rows}</TABLE>'
    )


def _cell(port: str, form: str, text: str) -> str:
    return f'<TD ALIGN="LEFT" BALIGN="LEFT">{escape(port)} {_soft(form)}<BR/>{_soft(text)}</TD>'


def _soft(text: str) -> str:
    return text and f'<FONT POINT-SIZE="12" COLOR="#000000b0">{escape(text)}</FONT>'
