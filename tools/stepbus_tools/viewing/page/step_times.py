"""How long the steps of a run took: read from timing.mcap, and shown on its page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.recording.timing import StepTiming
from stepbus_orchestrator.run.reports import Lateness, in_units

from .svg import legend

_EDGES_US: NDArray[np.float64] = np.logspace(0, 6, 37)
"""Of the bins of the histogram [µs]; the last one has the rest too."""
_WIDTH, _HEIGHT = 640.0, 220.0
_MOST_LABELS = 6
_COLOURS = 7

_decode = msgspec.msgpack.Decoder(StepTiming).decode


@dataclass
class StepTimes:
    """The times of one participant's steps. compute, wait: sums [ns]. counts: of each bin."""

    steps: int = 0
    compute: int = 0
    wait: int = 0
    longest: int = 0
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(_EDGES_US), np.int64))

    def take(self, timing: StepTiming) -> None:
        """Take the next steps."""
        rows = np.array(timing.rows, dtype=np.int64).reshape(-1, 3)
        self.steps += len(rows)
        self.wait += int(rows[:, 1].sum())
        self.compute += int(rows[:, 2].sum())
        self.longest = max(self.longest, int(rows[:, 2].max(initial=0)))
        at = np.searchsorted(_EDGES_US, rows[:, 2] * 1e-3)
        self.counts += np.bincount(np.minimum(at, len(_EDGES_US) - 1), minlength=len(_EDGES_US))

    def quantile_us(self, share: float) -> float:
        """Return an upper bound of a share of the compute times [µs]."""
        at = int(np.searchsorted(np.cumsum(self.counts), share * self.steps))
        return float(_EDGES_US[min(at, len(_EDGES_US) - 1)])


def read_step_times(folder: Path) -> Mapping[str, StepTimes]:
    """Return participant → its step times; none without a timing.mcap that can be read."""
    times: dict[str, StepTimes] = {}
    try:
        with Recording(folder / layout.TIMING_FILE) as recording:
            port = recording.ports.get("steps")
            for entry in port.entries() if port else ():
                timing = _decode(entry.data)
                times.setdefault(timing.participant, StepTimes()).take(timing)
    except (RecordingFailed, msgspec.MsgspecError):
        return times
    return times


def times_html(times: Mapping[str, StepTimes]) -> str:
    """Return a table of participants, the slowest first, and a histogram."""
    names = sorted(times, key=lambda name: -times[name].compute)
    most = max((t.compute + t.wait) / max(1, t.steps) for t in times.values()) or 1.0
    rows = []
    for name in names:
        one = times[name]
        compute, wait = (x / max(1, one.steps) for x in (one.compute, one.wait))
        shares = "".join(
            f'<i class={style} style="width:{100 * time / most:.1f}%"></i>'
            for style, time in (("f0", compute), ("wait", wait))
        )
        rows.append(
            f"<tr><td>{escape(name)}</td><td>{in_units(compute * 1e-3)}</td>"
            f"<td>≤ {in_units(one.quantile_us(0.99))}</td>"
            f"<td>{in_units(one.longest * 1e-3)}</td><td>{in_units(wait * 1e-3)}</td>"
            f"<td class=bar>{shares}</td></tr>"
        )
    # By name, so that each has the same colour in every run.
    counts = {name: times[name].counts.tolist() for name in sorted(times)}
    edges = [in_units(edge) for edge in _EDGES_US]
    return (
        "<div class=scroll tabindex=0><table><tr><th>participant</th><th>compute</th><th>p99</th>"
        "<th>longest</th><th>wait</th><th class=bar>mean step: compute, wait</th></tr>"
        f"{''.join(rows)}</table></div><h3>Compute time of a step</h3>{_histogram(counts, edges)}"
    )


def lateness_html(late: Lateness) -> str:
    """Return how late the steps of a run in real time were."""
    labels = [f"{bound} µs" if bound.isdecimal() else bound for bound in late.histogram]
    text = (
        f"p50 {in_units(late.p50_us)}, p99 {in_units(late.p99_us)}, max {in_units(late.max_us)}, "
        f"at {late.factor:g} × real time"
    )
    chart = _histogram({"steps": list(late.histogram.values())}, labels)
    return f"<h3>Lateness of steps</h3><p>{text}</p>{chart}"


def _histogram(rows: Mapping[str, Sequence[int]], labels: Sequence[str]) -> str:
    """Return a histogram, one series over the other. rows: name → counts, one for each label."""
    shown = [i for i in range(len(labels)) if any(counts[i] for counts in rows.values())]
    if not shown:
        return ""
    first, last = shown[0], shown[-1] + 1
    most = max(max(counts[first:last]) for counts in rows.values())
    slot = _WIDTH / (last - first)
    width, parts = slot / len(rows) * 0.9, []
    for number, (name, counts) in enumerate(rows.items()):
        for index in range(first, last):
            if counts[index]:
                height = max(1.0, counts[index] / most * _HEIGHT)
                x = (index - first) * slot + number * slot / len(rows)
                parts.append(
                    f'<rect class="f{number % _COLOURS}" x="{x:.1f}" y="{_HEIGHT - height:.1f}" '
                    f'width="{max(1.0, width):.1f}" height="{height:.1f}"><title>{escape(name)}, '
                    f"up to {escape(labels[index])}: {counts[index]}</title></rect>"
                )
    for index in range(first, last, max(1, (last - first) // _MOST_LABELS)):
        x = (index - first) * slot
        anchor = ' text-anchor="end"' if x > 0.9 * _WIDTH else ""
        x = _WIDTH if anchor else x
        parts.append(f'<text x="{x:.1f}" y="{_HEIGHT + 18}"{anchor}>{escape(labels[index])}</text>')
    return (
        '<svg class="histogram" role="img" aria-label="histogram of compute times" '
        f'viewBox="0 0 {_WIDTH:g} {_HEIGHT + 26:g}">{"".join(parts)}</svg>{legend(list(rows))}'
    )
