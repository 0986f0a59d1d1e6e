"""Writes report.html: the data of its curves, and a section for each thing it shows."""

import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from importlib.resources.abc import Traversable
from itertools import zip_longest
from pathlib import Path
from string import Template
from typing import NamedTuple
from urllib.parse import quote

from stepbus_participant import ExtraMissing
from stepbus_tools.columns import dotted
from stepbus_tools.report.charts import Chart, ChartLine, path_of
from stepbus_tools.report.picture import draw
from stepbus_tools.theme import MARK, figure, png_figure, style_sheet, uplot
from stepbus_tools.viewing.exports.scene_file import REPLAY_POLICY, packed_replay, replay_html
from stepbus_tools.viewing.page.content import lateness_html, times_html
from stepbus_tools.viewing.page.head import again, comparison_html
from stepbus_tools.viewing.rasteriser import pixels_of
from stepbus_tools.whole_file import replaced

from .content import RunPage
from .curve_data import Curves
from .head import head

PAGE_FILE = "report.html"
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
_WIDEST = 480
"""Pixels of a camera still; a larger one is thinned."""


def write_page(
    paths: Sequence[Path],
    target: Path | None = None,
    problems: list[str] | None = None,
    *,
    has_replay: bool = False,
) -> Path:
    """Write the page of a run, or of several beside each other; return its path.

    paths: of recordings, or the folders of their runs. target: default: report.html beside the
    first recording. problems: gets what cannot be shown. has_replay: the page has the scene in
    motion too, which takes seconds and about a megabyte; it is left out without viser.

    Raises RecordingFailed when a recording cannot be read or the page cannot be written,
    ExtraMissing without uPlot.
    """
    runs = [RunPage(path) for path in paths]
    lost = [f"{run.path}: {text}" for run in runs for text in run.problems]
    replays: list[str] = []
    try:
        replays = [
            packed_replay(run.path) if has_replay and run.scene is not None else "" for run in runs
        ]
    except ExtraMissing as exc:
        lost.append(f"the page has no animated scene: {exc}")
    if problems is not None:
        problems += lost
    return render_page(runs, target or runs[0].path.with_name(PAGE_FILE), replays)


def render_page(runs: Sequence[RunPage], target: Path, replays: Sequence[str] = ()) -> Path:
    """Write the page of runs that have been read; raises as `write_page`.

    replays: of their scenes, packed; none where they are empty.
    """
    (library, library_style), assets = uplot("the page"), files(__package__ or "") / "assets"
    if len(runs) > 1:
        folders = [run.path.parent.name or run.path.stem for run in runs]
        for run, folder in zip(runs, folders, strict=True):
            run.label = folder if len(set(folders)) == len(folders) else str(run.path)
    curves = Curves(runs)
    sections = [
        Section("curves", "Curves", curves.html()),
        Section("path", "Path of the base, from above", _path(runs)),
        Section("camera", "Camera", "".join(map(_camera_stills, runs))),
        Section("happenings", "Events and faults", _events(runs)),
        Section("timing", "Step times", "".join(map(_times, runs))),
        Section("wiring", "Wiring", "".join(dict.fromkeys(run.wiring for run in runs))),
        Section("again", "Run it again", "".join(map(again, runs))),
    ]
    title = " · ".join(dict.fromkeys(run.name for run in runs))
    text = Template(_read(assets / "page.html")).substitute(
        title=escape(f"{title}: {'comparison' if len(runs) > 1 else 'report'}"),
        policy=REPLAY_POLICY if any(replays) else _POLICY,
        icon=quote(MARK),
        mark=MARK + "stepbus",
        several=" several" if len(runs) > 1 else "",
        head="".join(map(head, runs)),
        comparison=str(Section("comparison", "Comparison", comparison_html(runs))),
        scene=_scenes(runs, replays),
        contents="".join(f'<a href="#{s.id}">{s.title}</a>' for s in sections if s.content),
        sections="".join(map(str, sections)),
        style=style_sheet() + library_style + _read(assets / "page.css"),
        library=library,
        data=_script(curves.data()),
        script=_read(assets / "page.js"),
    )
    with replaced(target) as part:
        part.write_text(text, encoding="utf-8")
    return target


def _read(file: Traversable) -> str:
    return file.read_text("utf-8")


def _script(value: object) -> str:
    """Return JSON that ends no script."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


class Section(NamedTuple):
    """A section of the page; one without content is not there."""

    id: str
    title: str
    content: str

    def __str__(self) -> str:
        """Return it as HTML."""
        inner = f"<h2>{self.title}</h2>{self.content}"
        return f'<section id="{self.id}">{inner}</section>' if self.content else ""


def _scenes(runs: Sequence[RunPage], replays: Sequence[str]) -> str:
    rows = [
        figure(run.scene, f"{run.label} t = {run.end_s:.2f} s".strip()) + replay_html(packed)
        for run, packed in zip_longest(runs, replays, fillvalue="")
        if isinstance(run, RunPage) and run.scene is not None
    ]
    return f'<div class="scene">{"".join(f"<div>{row}</div>" for row in rows)}</div>'


def _camera_stills(run: RunPage) -> str:
    rows = []
    for camera in run.cameras:
        for t, image in camera.images:
            every = -(-image.width // _WIDEST) or 1
            try:
                pixels = pixels_of(image)[::every, ::every]
            except ValueError:
                continue
            rows.append(figure(pixels, f"{dotted(camera.port)}, t = {t:.2f} s"))
    return f'<div class="stills">{"".join(rows)}</div>' if rows else ""


def _path(runs: Sequence[RunPage]) -> str:
    ports = [(run.label, port) for run in runs for port in run.ports]
    lines = [
        ChartLine(f"{label} {port.name}".strip(), path, number=number)
        for number, (label, port) in enumerate(ports)
        if (path := path_of(port)) is not None
    ]
    if not lines:
        return ""
    picture = draw("", [Chart("path from above", "m", lines, is_path=True)])
    return png_figure(picture, "the path of the base from above")


def _events(runs: Sequence[RunPage]) -> str:
    rows = "".join(
        f'<tr class="{escape(one.level)}"><td>{one.t:.3f} s</td>'
        f"<td>{escape(run.label)}</td><td>{escape(one.level)}</td><td>{escape(one.source)}</td>"
        f"<td>{escape(one.text)}</td></tr>"
        for run in runs
        for one in run.events
        if "\n" not in one.text
    )
    left = sum(run.events_left for run in runs)
    more = f"<p>{left} more are in the recording.</p>" if left else ""
    return (
        f"<div class=scroll tabindex=0><table class=events>{rows}</table></div>{more}"
        if rows
        else ""
    )


def _times(run: RunPage) -> str:
    if not run.times:
        return ""
    late = run.result.real_time if run.result else None
    title = f"<h3>{escape(run.label)}</h3>" if run.label else ""
    return title + times_html(run.times) + (lateness_html(late) if late else "")
