"""Workers of a Ray cluster, which has the processes and gives each run a core."""

import logging
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes import PYTHON
from stepbus_orchestrator.run.folder import scratch_folder
from stepbus_participant import need
from stepbus_schemas import error_text
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.bundle import Bundle
from stepbus_tools.sweep.pool import Answer, PoolOptions, wait_for_start
from stepbus_tools.sweep.row_run import plot_run
from stepbus_tools.sweep.trial import Files, Trials

_START_S = 60.0


def _run(bundle: Bundle, point: Point, options: PoolOptions) -> tuple[bytes, Files]:
    """Run a point in a process of Ray, as of `Trials.run`."""
    # On a cluster, a folder of that name is another folder on another machine.
    with scratch_folder("sweep") as folder:
        trials = Trials(bundle, folder, keep=options.keep, home=None)
        return trials.run(point, options.timeout_s)


def _check(bundle: Bundle) -> None:
    """Load what runs need, in a process of Ray; raises MetricFailed."""
    with scratch_folder("sweep") as folder:
        Trials(bundle, folder, keep="none", home=None).load_metrics()


class RayWorkers:
    """Runs points on a Ray cluster.

    Raises ExtraMissing where Ray is not installed, StartFailed where no cluster is at the address
    or a metric cannot be loaded.
    """

    def __init__(self, bundle: Bundle, options: PoolOptions, interrupt: threading.Event) -> None:
        self._bundle = bundle
        self._interrupt = interrupt
        self._options = options
        (self._ray,) = need("a sweep with an address", "ray")

    def __enter__(self) -> Self:
        """Join the cluster."""
        ray = self._ray
        if ray.is_initialized():
            raise StartFailed("this process already uses Ray: call ray.shutdown() before the sweep")
        logging.getLogger("ray").setLevel(logging.ERROR)
        try:
            ray.init(
                address=self._options.address,
                runtime_env={"env_vars": PYTHON},
                namespace=f"stepbus-{os.urandom(16).hex()}",
                logging_level="ERROR",
                log_to_driver=False,
                configure_logging=False,
            )
        except Exception as exc:
            ray.shutdown()
            raise StartFailed(
                f"could not connect to Ray at {self._options.address}: {exc}"
            ) from exc
        try:
            self._stored = ray.put(self._bundle)
            remote = ray.remote(num_cpus=1, max_retries=0)
            self._remote = remote(_run)
            checked = remote(_check).remote(self._stored)
            wait_for_start(
                lambda s: bool(ray.wait([checked], timeout=s)[0]), _START_S, self._interrupt
            )
            ray.get(checked)
        except BaseException as exc:
            ray.shutdown()
            if not isinstance(exc, ray.exceptions.RayError):
                raise
            raise StartFailed(
                f"could not start a worker: {getattr(exc, 'cause', exc)}; see `ray status`"
            ) from exc
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the cluster, which ends the runs of this sweep."""
        self._ray.shutdown()

    def cores(self) -> int:
        """Return how many runs may go on at once; on a cluster, cores come and go."""
        cores = int(self._ray.cluster_resources().get("CPU", 0))
        return max(1, min(cores, self._options.jobs or cores))

    def start(self, point: Point) -> Any:
        """Return the reference of a run that Ray has got."""
        return self._remote.remote(self._stored, point, self._options)

    def answers(self, keys: Sequence[Any], timeout_s: float) -> Iterator[tuple[Any, Answer]]:
        """Yield reference and answer of each run that has ended, as of `Workers`."""
        ready, _ = self._ray.wait(list(keys), timeout=timeout_s)
        for reference in ready:
            yield reference, self._answer(reference)

    def plot(self, pictures: Mapping[int, Path], interrupt: threading.Event) -> None:
        """Plot runs on this machine, as of `Workers`."""
        for number, picture in pictures.items():
            if not interrupt.is_set():
                plot_run(self._options.home, number, picture, interrupt)

    def _answer(self, reference: Any) -> Answer:
        errors = self._ray.exceptions
        try:
            row, files = self._ray.get(reference)
        except errors.RayTaskError as exc:
            return b"", {}, error_text(exc.cause)
        except errors.RayError:
            return b"", {}, ""
        return row, files, ""
