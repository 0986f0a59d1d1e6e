"""`stepbus run --watch`: a run, and another one whenever a file of its scenario changes."""

import contextlib
import hashlib
import itertools
import json
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.cli.commands import Run
from stepbus_orchestrator.cli.interrupts import INTERRUPTED, interrupting
from stepbus_orchestrator.cli.terminal.output import print_error, say
from stepbus_orchestrator.cli.terminal.stdout_buffer import is_read
from stepbus_orchestrator.plugins import view
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.layout import RUN_FILE
from stepbus_orchestrator.run.folder import new_folder
from stepbus_orchestrator.run.result import result_beside
from stepbus_orchestrator.scenario.extend import chain
from stepbus_orchestrator.scenario.locate import locate
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.scenario_files import WATCH_FILE
from stepbus_participant import ExtraMissing, need, read_file, replaced
from stepbus_schemas import StepbusError, WiringError

_TICK_MS = 100
"""How often it looks for changes, and how long none must come for a run [ms]."""
_LONGEST_MS = 1600
_AGAIN_S = 0.2
_PATIENCE_S = 5.0
_PAGE, _REPORT, _NEWEST = "watch.html", "report.html", WATCH_FILE


class _State(NamedTuple):
    """Of the scenario: the digests of its files, or what is wrong with it."""

    digests: dict[Path, bytes]
    error: str


def watch(given: Run, load: Callable[[Run], Scenario], interrupt: threading.Event) -> int:
    """Run until the user ends it; return 130 if a run was in progress then, 0 otherwise.

    load: returns the scenario with all that the options change of it.
    """
    (library,) = need("--watch", "watchfiles")
    for option in ("json", "view"):
        if getattr(given, option):
            raise WiringError(f"--{option} cannot be combined with --watch")
    watching = _Watch(given, load)
    try:
        while is_read() and not interrupt.is_set():
            folders = watching.folders()
            watching.look()
            changes = library.watch(
                *folders,
                watch_filter=None,
                debounce=_LONGEST_MS,
                step=_TICK_MS,
                rust_timeout=_TICK_MS,
                yield_on_timeout=True,
                stop_event=interrupt,
                recursive=False,
            )
            # What has changed before it began to watch is seen by the first look.
            for number, names in enumerate(changes):
                if names or not number:
                    watching.look()
                watching.follow(interrupt)
                if not is_read() or interrupt.is_set() or watching.folders() != folders:
                    break
        return INTERRUPTED if watching.is_running() else 0
    finally:
        watching.close()


class _Watch:
    """The runs of a watch, one after the other.

    Raises SettingsError where there is no such scenario: it may be a typing error.
    """

    def __init__(self, given: Run, load: Callable[[Run], Scenario]) -> None:
        self._given, self._load = given, load
        self._file = locate(given.scenario)
        self._state = _State({}, "not yet loaded")
        self._out = given.out
        self._folder = Path()
        self._shown: Path | None = None
        self._before: Path | None = None
        self._run: subprocess.Popen[bytes] | None = None

    def folders(self) -> list[Path]:
        """Return the folders of its files: an editor may replace a file by another one."""
        paths = {self._file.parent, *(path.parent for path in self._state.digests)}
        paths |= {path.resolve().parent for path in self._state.digests}
        return sorted(path for path in paths if path.is_dir())

    def look(self) -> None:
        """Run again if the scenario or a file of it is not what it was."""
        old, new = self._state, self._read()
        if new == old:
            return
        self.end()
        self._state = new
        paths = {**old.digests, **new.digests}
        named = [p.name for p in paths if old.digests.get(p) != new.digests.get(p)]
        if new.error:
            print_error(f"{new.error}\nwaiting for a change")
        else:
            self._start(", ".join(named) if old.digests else "")

    def _read(self) -> _State:
        error, paths = "", {*self._state.digests}
        try:
            scenario = self._load(self._given)
            paths = {*scenario.files.values()}
            self._out = self._out or Path("runs") / f"{scenario.name}-watch"
        except (StepbusError, OSError) as exc:
            error = str(exc)
        paths |= {*chain(self._file)}
        return _State(dict(_digests(sorted(paths))), error)

    def _start(self, why: str) -> None:
        self._folder = new_folder(self._out or Path("runs"), map(str, itertools.count(1)))
        if why:
            say(f"changed: {why}; run {self._folder}")
        self._run = subprocess.Popen([sys.executable, *_words(), "--out", str(self._folder)])

    def is_running(self) -> bool:
        """Return whether a run is in progress."""
        return self._run is not None

    def follow(self, interrupt: threading.Event) -> None:
        """Tell how a run that has just ended compares with the one before."""
        if self._run is None or interrupt.is_set():
            return
        code = self._run.poll()
        if self._shown != self._folder:
            self._show("")
        if code is None:
            return
        self._run = None
        recording = self._folder / RUN_FILE
        if code == 0 and self._before is not None:
            try:
                with interrupting():
                    line = _compared(self._before, recording)
                say(line)
                self._show(line)
            except KeyboardInterrupt:
                interrupt.set()
            except (StepbusError, OSError) as exc:
                print_error(f"cannot be compared with the run before: {exc}")
        if code == 0:
            self._before = recording

    def _show(self, line: str) -> None:
        """Let the page show the newest run, where it has a report."""
        if not (self._folder / _REPORT).exists():
            return
        self._shown = self._folder
        page, newest = self._folder.with_name(_PAGE), self._folder.with_name(_NEWEST)
        shown = json.dumps([f"{self._folder.name}/{_REPORT}", f"{self._folder}  {line}"])
        try:
            with replaced(newest) as part:
                part.write_text(f"show(...{shown});\n", encoding="utf-8")
            if not page.exists():
                page.write_bytes(files(__package__).joinpath(_PAGE).read_bytes())
                say(f"page      {page}, which shows each new run")
        except OSError as exc:
            print_error(f"{exc.filename}: {exc.strerror}")

    def end(self) -> None:
        """End a run in progress cleanly: the first signal ends it, the next one its report."""
        run, waited_s = self._run, 0.0
        while run is not None and run.poll() is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                run.send_signal(2)
                run.wait(_AGAIN_S)
            waited_s += _AGAIN_S
            if waited_s - _AGAIN_S < _PATIENCE_S <= waited_s:
                print_error(f"waiting for the run (pid {run.pid}) to end")
        if run is not None and run.returncode == 0:
            # Only its report was interrupted.
            self._before = self._folder / RUN_FILE
        self._run = None

    def close(self) -> None:
        """End what is left."""
        self.end()
        with contextlib.suppress(OSError):
            self._folder.rmdir()


def _digests(paths: list[Path]) -> Iterator[tuple[Path, bytes]]:
    for path in paths:
        with contextlib.suppress(OSError):
            yield path, hashlib.blake2b(read_file(path)).digest()


def _words() -> Iterator[str]:
    """Yield the words of this command without `--watch` and `--out`: those of one run.

    It is a process of its own, so that no run sees a module of the one before.
    """
    words = iter(sys.orig_argv[1:])
    for word in words:
        if word == "--out":
            next(words)
        elif word != "--watch" and not word.startswith("--out="):
            yield word


def _compared(before: Path, now: Path) -> str:
    """Return how a run differs from the one before, in one line."""
    parts: list[str] = []
    with Recording(before) as first, Recording(now) as second:
        last, result = result_beside(first), result_beside(second)
    if last is None or result is None:
        return "cannot be compared with the run before: a result.json is missing"
    with contextlib.suppress(ExtraMissing):
        old, new = map(view("metrics"), (last, result))
        if "rmse" in old and "rmse" in new:
            unit = new.units["rmse"]
            figures = (f"{1e3 * each['rmse']:.3g}" for each in (old, new))
            parts.append(f"RMSE {' → '.join(figures)} m{unit.replace(', ', ', m')}")
    found = diff(before, now)
    if found.equal:
        parts.append("same messages as the run before")
    elif found.divergence is None:
        parts.append("other ports than the run before")
    else:
        step, what = found.divergence.step, found.divergence.detail("before", "now")
        t_s = step * result.step_ns * 1e-9
        parts.append(f"diverges from the run before at step {step}, t = {t_s:g} s: {what}")
    return "; ".join(parts)
