"""What a live view costs a run: steps/s and processor time, with and without a viewer.

python benchmarks/view_cost.py [SCENARIO] [DURATION] [ROUNDS]; a client without a screen takes what
a browser would.
"""

import asyncio
import json
import re
import subprocess
import sys
import tempfile
import threading
import urllib.request
from pathlib import Path
from statistics import median
from typing import Any
from urllib.parse import urljoin

import psutil
import viser
from websockets.asyncio.client import connect

STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli", "run"]


async def _drain(address: str) -> None:
    with urllib.request.urlopen(address) as answer:
        cookie = answer.headers["Set-Cookie"].partition(";")[0]
        place = answer.read().decode().partition("url=")[2].partition('"')[0]
    socket = urljoin(address, place).replace("http://", "ws://")
    protocol = f"viser-v{viser.__version__}"
    async with connect(
        socket,
        subprotocols=[protocol],  # type: ignore[list-item]
        additional_headers={"Cookie": cookie},
        max_size=None,
    ) as client:
        async for _ in client:
            pass


def _watch(address: str) -> None:
    try:
        asyncio.run(_drain(address))
    except Exception as exc:  # noqa: BLE001  (the run has ended)
        print(f"  (client: {type(exc).__name__})", file=sys.stderr)


def _seconds(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system + times.children_user + times.children_system)


def run(scenario: str, duration: str, *, is_watched: bool) -> dict[str, float]:
    """Run once; returns steps/s, processor time of the run and of the page [s]."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--set", f"duration={duration}", "--no-report", "--json"]
        view = ["--view", "--no-open"] if is_watched else []
        command = [*STEPBUS, scenario, *options, *view, "--out", str(Path(folder) / "run")]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            own, page = psutil.Process(process.pid), 0.0
            viewer: Any = None
            if is_watched and process.stderr is not None:
                line = process.stderr.readline().decode()
                address = re.search(r"http://\S+", line)
                if address is None:
                    raise SystemExit(line)
                viewer = next(p for p in own.children() if "view" in p.cmdline())
                threading.Thread(target=_watch, args=(address[0],), daemon=True).start()
            total, loaded = 0.0, None
            while process.poll() is None:
                try:
                    others = [p for p in own.children() if viewer is None or p.pid != viewer.pid]
                    now = _seconds(own) + sum(map(_seconds, others))
                    if viewer is not None:
                        # When it has ended, its time is among that of the run's children.
                        page = _seconds(viewer)
                        loaded = page if loaded is None else loaded
                    total = now
                except psutil.NoSuchProcess:
                    pass
                threading.Event().wait(0.1)
            result = json.loads(process.stdout.read()) if process.stdout is not None else {}
    speed = result["steps"] / result["wall_s"]
    watched_s = page - (loaded or 0.0)
    return {"steps/s": speed, "run": total, "page": watched_s, "wall": result["wall_s"]}


def main(scenario: str = "two_link", duration: str = "60s", rounds: str = "3") -> None:
    """Print medians of interleaved rounds."""
    rows: dict[bool, list[dict[str, float]]] = {False: [], True: []}
    for _ in range(int(rounds)):
        for is_watched, measured in rows.items():
            measured.append(run(scenario, duration, is_watched=is_watched))
    for is_watched, measured in rows.items():
        name = "watched" if is_watched else "alone"
        values = {key: median(row[key] for row in measured) for key in measured[0]}
        print(
            f"{scenario} {name:8}{values['steps/s']:8.0f} steps/s in {values['wall']:.2f} s; "
            f"processor time of the run {values['run']:.2f} s, of the page {values['page']:.2f} s"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
