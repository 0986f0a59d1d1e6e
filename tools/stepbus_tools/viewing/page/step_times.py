"""How long the steps of a run took: read from timing.mcap, and shown on its page."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.recording.timing import StepTiming
from stepbus_orchestrator.run.reports import Lateness, in_units

_decode = msgspec.msgpack.Decoder(StepTiming).decode


@dataclass(frozen=True, kw_only=True)
class StepTimes:
    """How long one participant waited and computed, shape (steps,) [µs]."""

    wait: NDArray[np.float64]
    compute: NDArray[np.float64]


def read_step_times(folder: Path) -> Mapping[str, StepTimes]:
    """Return participant → its step times; none without a timing.mcap that can be read."""
    rows: dict[str, list[NDArray[np.float64]]] = {}
    try:
        with Recording(folder / layout.TIMING_FILE) as recording:
            port = recording.ports.get("steps")
            for entry in port.entries() if port else ():
                timing = _decode(entry.data)
                part = np.array(timing.rows, dtype=float).reshape(-1, 3)
                rows.setdefault(timing.participant, []).append(part * 1e-3)
    except (RecordingFailed, msgspec.MsgspecError):
        pass
    whole = {name: np.concatenate(parts) for name, parts in rows.items()}
    return {
        name: StepTimes(wait=part[:, 1], compute=part[:, 2])
        for name, part in whole.items()
        if len(part)
    }


def times_html(times: Mapping[str, StepTimes]) -> str:
    """Return a table of participants, the slowest first."""
    names = sorted(times, key=lambda name: -float(times[name].compute.sum()))
    most = max(float(np.mean(t.compute + t.wait)) for t in times.values()) or 1.0
    rows = []
    for name in names:
        compute, wait = times[name].compute, times[name].wait
        shares = "".join(
            f'<i class={style} style="width:{100 * time.mean() / most:.1f}%"></i>'
            for style, time in (("f0", compute), ("wait", wait))
        )
        figures = (compute.mean(), np.percentile(compute, 99), compute.max(), wait.mean())
        cells = "".join(f"<td>{in_units(float(value))}</td>" for value in figures)
        rows.append(f"<tr><td>{escape(name)}</td>{cells}<td class=bar>{shares}</td></tr>")
    return (
        "<div class=scroll tabindex=0><table><tr><th>participant</th><th>compute</th><th>p99</th>"
        "<th>longest</th><th>wait</th><th class=bar>mean step: compute, wait</th></tr>"
        f"{''.join(rows)}</table></div>"
    )


def lateness_html(late: Lateness) -> str:
    """Return how late the steps of a run in real time were."""
    return (
        f"<h3>Lateness of steps</h3><p>p50 {in_units(late.p50_us)}, p99 {in_units(late.p99_us)}, "
        f"max {in_units(late.max_us)}, at {late.factor:g} × real time</p>"
    )
