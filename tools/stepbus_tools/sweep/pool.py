"""Points as tasks of Ray, on this machine or on a cluster.

Ray has the processes and gives each task a core. A point whose process dies is run again; nothing
else is lost.
"""

import logging
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, Self

import msgspec

from stepbus_orchestrator.errors import ExitCode, StartFailed
from stepbus_orchestrator.processes import PYTHON
from stepbus_participant import need
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.bundle import Bundle
from stepbus_tools.sweep.rows import ResultRow, failed_row
from stepbus_tools.sweep.trial import Files, Trials

_TEMPORARY = "stepbus-ray-"
_WAIT_S = 0.25
_MOST_DEATHS = 3
_LONGEST_FOLDER = 22
_START_S = 60.0
_RETRIED = frozenset(
    (ExitCode.START, ExitCode.DIED, ExitCode.STEP_TIMEOUT, ExitCode.BUS, ExitCode.STOP_TIMEOUT)
)
"""Failures that a machine can cause; any other would come again."""
_TIMED_OUT = "timed out"
Done = tuple[ResultRow, Files]
"""The row of a run, and its files where it stays and comes from a cluster."""


@dataclass(frozen=True, kw_only=True)
class PoolOptions:
    """How a pool runs points.

    jobs: processes at once; 0: as many as there are cores. keep: which runs stay. home: the
    sweep's folder. timeout_s: of a run; 0: none. retries: of a run that a machine may have failed.
    address: of a Ray cluster; empty: one is started here, and ended.
    """

    home: Path
    jobs: int = 0
    keep: str = "failed"
    timeout_s: float = 0.0
    retries: int = 0
    address: str = ""


@dataclass
class _Task:
    point: Point
    attempts: int = 0
    deaths: int = 0
    since: float = field(default_factory=time.monotonic)

    def row(self, outcome: str, reason: str, code: ExitCode) -> ResultRow:
        """Return the row of a run that has no result of its own."""
        return self.counted(failed_row(self.point, outcome, reason, code))

    def counted(self, row: ResultRow) -> ResultRow:
        """Return a row with the number of attempts."""
        return msgspec.structs.replace(row, attempts=self.attempts)


def _run_point(
    bundle: Bundle, point: Point, options: PoolOptions, temporary: str | None
) -> tuple[bytes, Files]:
    """Run a point in a process of Ray; return its row as JSON, and the files of a run to keep.

    A run that takes longer than `timeout_s` ends the process: the kernel's timer does so even if
    the run hangs in C.
    """
    signal.setitimer(signal.ITIMER_REAL, options.timeout_s)
    try:
        # On a cluster, a folder of that name is another folder on another machine.
        home = None if options.address else options.home
        with Trials(bundle, keep=options.keep, home=home, temporary=temporary) as trials:
            row, files = trials.run(point)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return msgspec.json.encode(msgspec.structs.replace(row, where=os.uname().nodename)), files


def _check(bundle: Bundle) -> None:
    """Load a bundle in a process of Ray; raises MetricFailed as `Trials`."""
    with Trials(bundle, keep="none", home=None):
        pass


class Pool:
    """Runs points on Ray; enter it, and iterate over the results of `run`.

    Raises ExtraMissing where Ray is not installed, StartFailed where it does not start, no cluster
    is at the address or a metric cannot be loaded.
    """

    def __init__(self, bundle: Bundle, options: PoolOptions) -> None:
        self._bundle = bundle
        self._options = replace(options, home=options.home.resolve())
        self._set_environment()
        (self._ray,) = need("a sweep", "ray")
        self._temporary = ""

    def _set_environment(self) -> None:
        """Tell Ray, which reads it when it is imported, to call no one and to let no one in."""
        logging.getLogger("ray").setLevel(logging.ERROR)
        os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}
        if not self._options.address and "ray" not in sys.modules:
            # With the token, one runs code as this user: it is in no file and on no command line.
            # Without one, Ray leaves its own in the user's home.
            os.environ |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": os.urandom(32).hex()}
            # A Ray that is no cluster listens on 127.0.0.1 only, whatever the variable is called.
            os.environ |= {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}

    def __enter__(self) -> Self:
        """Start Ray, or join the cluster."""
        if self._ray.is_initialized():
            raise StartFailed("this process already uses Ray: call ray.shutdown() before the sweep")
        address = self._options.address
        options: dict[str, Any] = {"address": address}
        if not address:
            # Ray lets every user into its own folder, so that lies in one of ours.
            # The names of its sockets may have 107 bytes.
            usual = tempfile.gettempdir()
            folder = usual if len(usual) <= _LONGEST_FOLDER else "/tmp"  # noqa: S108
            self._temporary = tempfile.mkdtemp(prefix=_TEMPORARY, dir=folder)
            options = {
                "num_cpus": self._options.jobs or os.cpu_count(),
                "include_dashboard": False,
                "_temp_dir": f"{self._temporary}/r",
                "object_store_memory": 200_000_000,
            }
        try:
            self._ray.init(
                **options,
                runtime_env={"env_vars": PYTHON},
                namespace=f"stepbus-{os.urandom(16).hex()}",
                logging_level="ERROR",
                log_to_driver=False,
                configure_logging=False,
            )
        except Exception as exc:
            self._end()
            failed = f"connect to Ray at {address}" if address else "start Ray"
            raise StartFailed(f"could not {failed}: {exc}") from exc
        try:
            self._stored = self._ray.put(self._bundle)
            remote = self._ray.remote(num_cpus=1, max_retries=0)
            self._run = remote(_run_point)
            self._ray.get(remote(_check).remote(self._stored), timeout=_START_S)
        except self._ray.exceptions.RayError as exc:
            self._end()
            why = getattr(exc, "cause", exc)
            if isinstance(exc, self._ray.exceptions.GetTimeoutError):
                why = f"none within {_START_S:.0f} s; is a core free? See `ray status`"
            raise StartFailed(f"could not start a worker: {why}") from exc
        return self

    def __exit__(self, *_: object) -> None:
        """End all processes, and the Ray that was started here."""
        self._end()

    def _end(self) -> None:
        self._ray.shutdown()
        if self._temporary:
            shutil.rmtree(self._temporary, ignore_errors=True)

    def run(self, points: Iterable[Point], is_over: Callable[[], bool]) -> Iterator[Done]:
        """Yield row and files of each point, as they come; until all have, or it is over."""
        tasks, pending = map(_Task, points), dict[Any, _Task]()
        while not is_over():
            idle = max(0, self._cores() - len(pending))
            pending |= {self._start(task): task for task in islice(tasks, idle)}
            if not pending:
                return
            ready, _ = self._ray.wait(list(pending), timeout=_WAIT_S)
            for reference in ready:
                task = pending.pop(reference)
                done = self._done(task, reference)
                if done is None:
                    pending[self._start(task)] = task
                else:
                    yield done

    def _cores(self) -> int:
        """Return how many tasks may run at once; on a cluster, cores come and go."""
        cores = int(self._ray.cluster_resources().get("CPU", 0))
        return max(1, min(cores, self._options.jobs or cores))

    def _start(self, task: _Task) -> Any:
        """Return the reference of a task that Ray has got."""
        task.attempts += 1
        task.since = time.monotonic()
        temporary = self._temporary or None
        return self._run.remote(self._stored, task.point, self._options, temporary)

    def _done(self, task: _Task, reference: Any) -> Done | None:
        """Return the row and files of a finished task; None if it has to run again."""
        errors, limit_s = self._ray.exceptions, self._options.timeout_s
        try:
            answer = self._ray.get(reference)
        except errors.RayTaskError as exc:
            return task.row("failed", f"{exc.cause}", ExitCode.INTERNAL), {}
        except errors.RayError:
            if limit_s and time.monotonic() - task.since >= limit_s:
                reason = f"it exceeded the limit of {limit_s:g} s"
                return task.row(_TIMED_OUT, reason, ExitCode.STEP_TIMEOUT), {}
            task.deaths += 1
            if task.deaths < _MOST_DEATHS:
                return None
            reason = f"its worker process died {task.deaths} times"
            return task.row("died", reason, ExitCode.DIED), {}
        row, files = msgspec.json.decode(answer[0], type=ResultRow), answer[1]
        if row.exit_code in _RETRIED and task.attempts <= self._options.retries:
            return None
        return task.counted(row), files
