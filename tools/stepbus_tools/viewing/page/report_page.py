"""Writes report.html."""

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib.resources import files
from importlib.resources.abc import Traversable
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any

from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.reports import in_units
from stepbus_participant import ExtraMissing, extra_hint
from stepbus_schemas import Image, StepbusError
from stepbus_tools.report import write_report
from stepbus_tools.viewing.page.joint_curves import Arrays
from stepbus_tools.viewing.page.timeline import EDGES_US
from stepbus_tools.viewing.render import pixels_of
from stepbus_tools.whole_file import replaced

from .run import RunPage, read_run
from .svg import bars, figure, path_from_above

PAGE_FILE = "report.html"
_WIDEST = 480
"""Pixels of a camera still; a larger one is thinned."""


def report(
    paths: Sequence[Path], target: Path | None = None, problems: list[str] | None = None
) -> Path:
    """Write the page of a run, or of several beside each other, with their summaries; its path.

    problems: gets what cannot be shown. paths, target, and what is raised: as of `write_page`.
    """
    files = [layout.recording_file(path) for path in paths]
    lines = [write_report(path, has_plots=False) for path in files]
    return write_page(files, target, lines, problems)


def write_page(
    paths: Sequence[Path],
    target: Path | None = None,
    lines: Sequence[Sequence[str]] = (),
    problems: list[str] | None = None,
) -> Path:
    """Write the page of a run, or of several beside each other; return its path.

    paths: of recordings, or the folders of their runs. target: default: report.html beside the
    first recording. lines: what the summary of each run says of its recording. problems: gets what
    cannot be shown.

    Raises RecordingFailed when a recording cannot be read or the page cannot be written,
    ExtraMissing without uPlot.
    """
    charts = _charts()
    arrays = Arrays()
    known = lines or [()] * len(paths)
    runs = [read_run(path, arrays, own) for path, own in zip(paths, known, strict=True)]
    if problems is not None:
        problems += [f"{run.path}: {text}" for run in runs for text in run.problems]
    target = target or runs[0].path.with_name(PAGE_FILE)
    room = files(__package__ or "") / "assets"
    title = " · ".join(dict.fromkeys(run.name for run in runs))
    labels = _labels(runs)
    text = Template(_read(room / "page.html")).substitute(
        title=escape(f"{title}: {'comparison' if len(runs) > 1 else 'report'}"),
        head="".join(_head(run, label) for run, label in zip(runs, labels, strict=True)),
        stills=_section("The scene at its end", _scenes(runs, labels)),
        pictures=_section("Camera", "".join(map(_stills, runs))),
        path=_section("Path of the base, from above", _paths(runs, labels)),
        happenings=_section("Events and faults", _happenings(runs, labels)),
        timing=_section("Step times", _timing(runs, labels)),
        again=_section("Run it again", "".join(map(_again, runs))),
        style=_read(charts / "uPlot.min.css") + _read(room / "page.css"),
        library=_read(charts / "uPlot.iife.js"),
        data=_script(_data(runs, labels, arrays)),
        script=_read(room / "page.js"),
    )
    with replaced(target) as part:
        part.write_text(text, encoding="utf-8")
    return target


def page_line(recording: Path, lines: Sequence[str]) -> str:
    """Write the page of a run, and return what its summary should say of it.

    lines: of the summary. A page that cannot be written changes no run.
    """
    try:
        return f"report    {write_page([recording], lines=[lines])}"
    except StepbusError as exc:
        return f"no report {exc}"


def _charts() -> Path:
    """Return the folder of uPlot, which the package uplot-python carries."""
    # It is not imported: that would load IPython.
    spec = find_spec("uplot")
    for place in (spec.submodule_search_locations or ()) if spec else ():
        if (static := Path(place) / "static").is_dir():
            return static
    raise ExtraMissing(f"the page needs uplot, which is not installed{extra_hint('uplot')}")


def _read(file: Traversable) -> str:
    return file.read_text("utf-8")


def _script(value: object) -> str:
    """Return JSON that ends no script."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


def _labels(runs: Sequence[RunPage]) -> list[str]:
    """Return a short name of each run: the folder, where that tells them apart."""
    if len(runs) == 1:
        return [""]
    names = [run.path.parent.name or run.path.stem for run in runs]
    return names if len(set(names)) == len(names) else [str(run.path) for run in runs]


def _data(runs: Sequence[RunPage], labels: Sequence[str], arrays: Arrays) -> Mapping[str, Any]:
    return {
        "groups": runs[0].groups if len(runs) == 1 else _merged(runs, labels),
        "marks": [
            {**one.row(), "run": number}
            for number, run in enumerate(runs)
            for one in run.happenings
            if one.level != "info" or len(run.happenings) <= 30
        ],
        # What ended a run comes a step behind its last message.
        "end": max(t for run in runs for t in (run.end_s, *(one.t for one in run.happenings))),
        "runs": labels,
        "arrays": arrays.encoded(),
    }


def _merged(runs: Sequence[RunPage], labels: Sequence[str]) -> list[Mapping[str, Any]]:
    """Return the groups of several runs: each chart once, with the lines of all in it.

    What is the same for all, such as a reference, is there once.
    """
    groups: dict[str, dict[str, Any]] = {}
    for number, (run, label) in enumerate(zip(runs, labels, strict=True)):
        for group in run.groups:
            into = groups.setdefault(group["title"], {**group, "charts": {}})
            for chart in group["charts"]:
                kept = into["charts"].setdefault(chart["key"], {**chart, "lines": []})
                seen = {(line["t"], line["y"]) for line in kept["lines"]}
                kept["lines"] += [
                    {**line, "label": f"{label} {line['label']}", "run": number, "color": number}
                    for line in chart["lines"]
                    if (line["t"], line["y"]) not in seen or not line.get("dash")
                ]
    return [{**group, "charts": list(group["charts"].values())} for group in groups.values()]


def _section(title: str, content: str) -> str:
    return f"<section><h2>{title}</h2>{content}</section>" if content else ""


def _head(run: RunPage, label: str) -> str:
    result = run.result
    name = escape(run.name + (f" ({label})" if label else ""))
    if result is None:
        verdict, why = "unknown", "There is no result.json beside the recording."
    else:
        verdict, why = result.outcome, result.reason
        why = "It ran to its end." if why == verdict else why
        if result.exit_code and result.participant:
            why += f" ({result.participant}, step {result.at_step}, exit code {result.exit_code})"
    problems = "".join(f'<p class="problem">{escape(text)}</p>' for text in run.problems)
    warnings = "".join(
        f'<p class="problem">{escape(f"{w.level}: {w.source}, step {w.step}: {w.text}")}</p>'
        for w in (result.warnings[:10] if result else ())
    )
    lines = "".join(f"<li>{escape(line)}</li>" for line in run.lines if _is_shown(line))
    cells = "".join(
        f"<div><dt>{key}</dt><dd>{escape(value)}</dd></div>" for key, value in _facts(run)
    )
    return (
        f'<header><h1>{name} <span class="verdict {escape(verdict)}">{escape(verdict)}</span></h1>'
        f'<p class="reason">{escape(why)}</p>{problems}{warnings}<dl>{cells}</dl>'
        f"{f'<ul>{lines}</ul>' if lines else ''}</header>"
    )


def _is_shown(line: str) -> bool:
    return not line.startswith(("plots ", "no plots "))


def _facts(run: RunPage) -> Iterator[tuple[str, str]]:
    result = run.result
    yield "recording", str(run.path)
    if result is None:
        yield "last step", str(run.last_step)
        return
    yield "steps", f"{result.steps} of {result.step_ns * 1e-6:g} ms"
    yield "simulated", f"{result.simulated_s:g} s"
    speed = f"{result.wall_s:.2f} s, {result.real_time_factor:.2f} × real time"
    yield "wall time", speed
    yield "seed, window, transport", f"{result.seed}, {result.window}, {result.transport}"
    if result.faults:
        yield "faults", ", ".join(result.faults)
    drops = ", ".join(f"{count} by {name}" for name, count in result.drops.items() if count)
    if drops:
        yield "dropped messages", drops
    yield "sha256", result.sha256[:16]


def _scenes(runs: Sequence[RunPage], labels: Sequence[str]) -> str:
    rows = [
        figure(run.still, f"{label} t = {run.end_s:.2f} s".strip())
        for run, label in zip(runs, labels, strict=True)
        if run.still is not None
    ]
    return f'<div class="stills scene">{"".join(rows)}</div>' if rows else ""


def _stills(run: RunPage) -> str:
    rows = []
    for stills in run.stills:
        for t, image in stills.images:
            pixels = _pixels(image)
            if pixels is not None:
                name = f"{stills.port.participant}.{stills.port.name}, t = {t:.2f} s"
                rows.append(figure(pixels, name))
    return f'<div class="stills">{"".join(rows)}</div>' if rows else ""


def _pixels(image: Image) -> Any:
    """Return an image in colours, shape (rows, columns, 3); None where it is none."""
    every = -(-image.width // _WIDEST) or 1
    try:
        return pixels_of(image)[::every, ::every]
    except ValueError:
        return None


def _paths(runs: Sequence[RunPage], labels: Sequence[str]) -> str:
    paths = {
        f"{label} {path.port.participant}.{path.port.name}".strip(): points
        for run, label in zip(runs, labels, strict=True)
        for path in run.paths
        if len(points := path.points())
    }
    return path_from_above(paths) if paths else ""


def _happenings(runs: Sequence[RunPage], labels: Sequence[str]) -> str:
    rows = "".join(
        f'<tr class="{escape(one.level)}"><td>{one.t:.3f} s</td><td>{escape(label)}</td>'
        f"<td>{escape(one.level)}</td><td>{escape(one.source)}</td><td>{escape(one.text)}</td></tr>"
        for run, label in zip(runs, labels, strict=True)
        for one in run.happenings
    )
    left = sum(run.left_out for run in runs)
    more = f"<p>{left} more are in the recording.</p>" if left else ""
    return f"<div class=scroll><table>{rows}</table></div>{more}" if rows else ""


def _timing(runs: Sequence[RunPage], labels: Sequence[str]) -> str:
    return "".join(
        (f"<h3>{escape(label)}</h3>" if label else "") + _times(run) + _lateness(run)
        for run, label in zip(runs, labels, strict=True)
        if run.times
    )


def _times(run: RunPage) -> str:
    names = sorted(run.times, key=lambda name: -run.times[name].compute)
    most = max((t.compute + t.wait) / max(1, t.steps) for t in run.times.values()) or 1.0
    rows = []
    for name in names:
        one = run.times[name]
        compute, wait = (x / max(1, one.steps) for x in (one.compute, one.wait))
        rows.append(
            f"<tr><td>{escape(name)}</td><td>{in_units(compute * 1e-3)}</td>"
            f"<td>≤ {in_units(one.quantile_us(0.99))}</td>"
            f"<td>{in_units(one.longest * 1e-3)}</td><td>{in_units(wait * 1e-3)}</td>"
            f"<td class=bar>{_share('c0', compute / most)}{_share('wait', wait / most)}</td></tr>"
        )
    counts = {name: run.times[name].counts.tolist() for name in names}
    edges = [in_units(edge) for edge in EDGES_US]
    return (
        "<div class=scroll><table><tr><th>participant</th><th>compute</th><th>p99</th>"
        "<th>longest</th><th>wait</th><th>mean step: compute, wait</th></tr>"
        f"{''.join(rows)}</table></div><h3>Compute time of a step</h3>{bars(counts, edges)}"
    )


def _share(name: str, share: float) -> str:
    return f'<i class={name} style="width:{100 * share:.1f}%"></i>'


def _lateness(run: RunPage) -> str:
    late = run.result.real_time if run.result else None
    if late is None:
        return ""
    labels = [f"{bound} µs" if bound.isdecimal() else bound for bound in late.histogram]
    text = (
        f"p50 {in_units(late.p50_us)}, p99 {in_units(late.p99_us)}, max {in_units(late.max_us)}, "
        f"at {late.factor:g} × real time"
    )
    chart = bars({"steps": list(late.histogram.values())}, labels)
    return f"<h3>Lateness of steps</h3><p>{text}</p>{chart}"


def _again(run: RunPage) -> str:
    path = shlex.quote(str(run.path))
    rows = [f"stepbus rerun {path}"]
    if run.result is not None and run.result.file:
        sets = "".join(f" --set {shlex.quote(text)}" for text in run.result.overrides)
        rows.insert(0, f"stepbus run {shlex.quote(run.result.file)}{sets}")
    return "".join(f"<pre>{escape(row)}</pre>" for row in rows)
