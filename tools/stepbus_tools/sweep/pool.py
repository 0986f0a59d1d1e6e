"""Workers on Ray: one process each, which runs one point after the other.

Ray gives the processes, on this machine or on a cluster, and tells which of them have died. What
was in one that has died goes to another; nothing else is lost.
"""

import logging
import os
import shutil
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
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
_LOOK_S = 5.0
_MOST_DEATHS = 3
_LONGEST_FOLDER = 22
_START_S = 60.0
_CLOSE_S = 2.0
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

    def counted(self, row: ResultRow) -> ResultRow:
        return msgspec.structs.replace(row, attempts=self.attempts)


@dataclass(eq=False)
class _Worker:
    """One process of the pool; task: what it does, since `since` [s]."""

    actor: Any
    is_ready: bool = False
    task: _Task | None = None
    since: float = field(default_factory=time.monotonic)


class _Runner:
    """What runs in a worker."""

    def __init__(self, bundle: Bundle, keep: str, home: Path | None, temporary: str) -> None:
        self._trials = Trials(bundle, keep=keep, home=home, temporary=temporary or None)

    def close(self) -> None:
        """Remove what the worker has on its machine."""
        self._trials.close()

    def ready(self) -> None:
        """Return once the worker is there."""

    def run(self, point: Point) -> tuple[bytes, Files]:
        """Run a point; return its row as JSON, and the files of a run that stays."""
        row, files = self._trials.run(point)
        return msgspec.json.encode(msgspec.structs.replace(row, where=os.uname().nodename)), files


class Pool:
    """Runs points on Ray; enter it, and iterate over what `run` yields.

    Raises ExtraMissing where Ray is not installed, StartFailed where it does not start or no
    cluster is at the address.
    """

    def __init__(self, bundle: Bundle, options: PoolOptions) -> None:
        self._bundle = bundle
        self._options = options
        self._set_environment()
        (self._ray,) = need("a sweep", "ray")
        self._temporary = ""
        self._workers: list[_Worker] = []
        self._pending: dict[Any, _Worker] = {}
        """What Ray will answer, and the worker on it."""
        self._again: deque[_Task] = deque()
        self._looked = 0.0

    # --- Ray ------------------------------------------------------------------------------

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
            self._temporary = tempfile.mkdtemp(prefix=_TEMPORARY, dir=_short_folder())
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
        self._stored = self._ray.put(self._bundle)
        self._actor = self._ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(_Runner)
        return self

    def __exit__(self, *_: object) -> None:
        """End all workers, and the Ray that was started here."""
        self._end()

    def _end(self) -> None:
        idle = [worker.actor.close.remote() for worker in self._idle()]
        if idle:
            self._ray.wait(idle, num_returns=len(idle), timeout=_CLOSE_S)
        for worker in self._workers:
            self._ray.kill(worker.actor)
        self._workers.clear()
        self._ray.shutdown()
        if self._temporary:
            shutil.rmtree(self._temporary, ignore_errors=True)

    # --- work -----------------------------------------------------------------------------

    def run(self, points: Iterable[Point], is_over: Callable[[], bool]) -> Iterator[Done]:
        """Yield row and files of each point, as they come; until all have, or it is over."""
        tasks, started, has_more = map(_Task, points), time.monotonic(), True
        while not is_over():
            self._fit()
            for worker in self._idle():
                task = self._again.popleft() if self._again else next(tasks, None)
                if task is None:
                    has_more = False
                    break
                task.attempts += 1
                worker.task, worker.since = task, time.monotonic()
                self._pending[worker.actor.run.remote(task.point)] = worker
            if not (has_more or self._again or any(worker.task for worker in self._workers)):
                return
            if not self._workers_are_there(started):
                raise StartFailed(
                    f"no Ray worker has started within {_START_S:.0f} s: is a core free? "
                    "See `ray status`"
                )
            yield from self._finished()

    def _idle(self) -> list[_Worker]:
        return [worker for worker in self._workers if worker.is_ready and worker.task is None]

    def _fit(self) -> None:
        """Have as many workers as there are cores, which come and go on a cluster."""
        now = time.monotonic()
        if now - self._looked < _LOOK_S and self._workers:
            return
        self._looked = now
        options = self._options
        cores = int(self._ray.cluster_resources().get("CPU", 0))
        wanted = min(cores, options.jobs) if options.jobs else cores
        # On a cluster, a folder of that name is another folder on another machine.
        home = None if options.address else options.home.resolve()
        for _ in range(wanted - len(self._workers)):
            worker = _Worker(self._actor.remote(self._stored, options.keep, home, self._temporary))
            self._workers.append(worker)
            self._pending[worker.actor.ready.remote()] = worker

    def _workers_are_there(self, started: float) -> bool:
        """Return whether one has come, or may still do so."""
        is_late = time.monotonic() - started > _START_S
        return not is_late or any(worker.is_ready for worker in self._workers)

    def _finished(self) -> Iterator[Done]:
        """Yield what has come; put what goes to another worker aside."""
        if not self._pending:
            time.sleep(_WAIT_S)
            return
        ready, _ = self._ray.wait(list(self._pending), num_returns=1, timeout=_WAIT_S)
        for reference in ready:
            worker = self._pending.pop(reference)
            task, worker.task = worker.task, None
            if task is None:
                self._started(worker, reference)
                continue
            done = self._done(worker, task, reference)
            if done is not None:
                yield done
        yield from self._late()

    def _started(self, worker: _Worker, reference: Any) -> None:
        """Take a new worker; raises StartFailed for one that raises."""
        try:
            self._ray.get(reference)
            worker.is_ready = True
        except self._ray.exceptions.RayTaskError as exc:
            raise StartFailed(f"could not start a worker: {exc.cause}") from exc
        except self._ray.exceptions.RayError:
            self._drop(worker)

    def _done(self, worker: _Worker, task: _Task, reference: Any) -> Done | None:
        """Return what became of a task; None where another worker does it again."""
        errors = self._ray.exceptions
        try:
            answer = self._ray.get(reference)
        except errors.RayTaskError as exc:
            row = failed_row(task.point, "failed", f"{exc.cause}", ExitCode.INTERNAL)
            return task.counted(row), {}
        except (errors.RayActorError, errors.ObjectLostError, errors.RaySystemError):
            self._drop(worker)
            task.deaths += 1
            if task.deaths < _MOST_DEATHS:
                self._again.append(task)
                return None
            reason = f"its worker process died {task.deaths} times"
            return task.counted(failed_row(task.point, "died", reason, ExitCode.DIED)), {}
        row, files = msgspec.json.decode(answer[0], type=ResultRow), answer[1]
        if row.exit_code in _RETRIED and task.attempts <= self._options.retries:
            self._again.append(task)
            return None
        return task.counted(row), files

    def _late(self) -> Iterator[Done]:
        """Kill what takes too long, and yield its row."""
        limit_s, now = self._options.timeout_s, time.monotonic()
        for reference, worker in list(self._pending.items()):
            task = worker.task
            if limit_s and task is not None and now - worker.since >= limit_s:
                del self._pending[reference]
                self._drop(worker)
                reason = f"it exceeded the limit of {limit_s:g} s"
                row = failed_row(task.point, _TIMED_OUT, reason, ExitCode.STEP_TIMEOUT)
                yield task.counted(row), {}

    def _drop(self, worker: _Worker) -> None:
        self._ray.kill(worker.actor)
        if worker in self._workers:
            self._workers.remove(worker)
        self._looked = 0.0


def _short_folder() -> str:
    """Return a folder for Ray's sockets, whose names may have 107 bytes."""
    usual = tempfile.gettempdir()
    return usual if len(usual) <= _LONGEST_FOLDER else "/tmp"  # noqa: S108
