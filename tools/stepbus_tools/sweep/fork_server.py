"""The process of which each run of a sweep on this machine is a fork.

`python -P -m stepbus_tools.sweep.fork_server DESCRIPTOR` is sent a bundle and the options of a
sweep, and answers with an error or an empty text. Then it is sent numbers of runs, each with a
point or the path of a picture; each answer is a number, the row as JSON (empty where its process
has died) and an error. It sends None where nothing happens while runs go on. It ends with the other
end of the connection.
"""

import contextlib
import ctypes
import gc
import os
import signal
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from multiprocessing.connection import Connection, Pipe, wait
from pathlib import Path
from pkgutil import resolve_name

from stepbus_orchestrator.run.folder import scratch_folder
from stepbus_orchestrator.run.inprocess import heartbeat
from stepbus_orchestrator.run.inprocess.heartbeat import TICK_S, Heartbeat, Watcher
from stepbus_participant import is_ours
from stepbus_schemas import error_text
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.pool import PoolOptions
from stepbus_tools.sweep.trial import Trials

_PR_SET_PDEATHSIG = 1
_Result = tuple[bytes, str, list[str]]
"""Of a copy of this process: its answer, its error, and modules that others will need too."""
_Children = dict[Connection, tuple[int, Watcher]]
"""Where the result of each copy comes → its number, and what ends it where it hangs."""


def serve(channel: Connection) -> None:
    """Fork a process for each point, until the other end is closed."""
    children: _Children = {}
    with contextlib.suppress(EOFError, OSError), contextlib.ExitStack() as stack:
        bundle, options = channel.recv()
        try:
            folder = stack.enter_context(scratch_folder("sweep"))
            # Before its folder is removed, in which they write.
            stack.callback(_end, children)
            trials = Trials(bundle, folder, keep=options.keep, home=options.home)
            error = _load(trials, channel, children)
        except EOFError:
            return
        except Exception as exc:  # noqa: BLE001  (the caller reports it)
            error = str(exc) or error_text(exc)
        channel.send(error)
        while not error:
            ready = wait([channel, *children], TICK_S if children else None)
            if not ready:
                # As long as runs go on, the other end hears of us.
                channel.send(None)
            for source, (number, watcher) in list(children.items()):
                if source in ready:
                    row, why, modules = _answer(children, source)
                    channel.send((number, row, why))
                    _prepare(modules)
                elif watcher.is_late():
                    os.kill(watcher.pid, signal.SIGKILL)
            if channel in ready:
                number, task = channel.recv()
                _fork(children, number, partial(_result, trials, options, number, task))


def _load(trials: Trials, channel: Connection, children: _Children) -> str:
    """Load what the runs need; return why they cannot have it, or an empty text.

    The user's metrics are tried in a fork: one that starts a thread is loaded by each run, since a
    process with threads must not fork. Raises EOFError where the other end is closed meanwhile.
    """
    trials.prepare()

    def threads() -> _Result:
        trials.load_metrics()
        # A list of the kernel's.
        return str(len(os.listdir("/proc/self/task"))).encode(), "", []  # noqa: PTH208

    source = _fork(children, -1, threads)
    if channel in wait([channel, source]):
        raise EOFError
    count, error, _ = _answer(children, source)
    if count == b"1":
        trials.load_metrics()
    _prepare([])
    return error or ("" if count else "a metric has ended its process")


def _prepare(modules: list[str]) -> None:
    """Load what a run has loaded, and prepare it for those that follow."""
    for name in modules:
        with contextlib.suppress(Exception):
            getattr(import_module(name), "prepare", int)()
    # A child that changes the count of references to something copies its page.
    gc.collect()
    gc.freeze()


def _result(trials: Trials, options: PoolOptions, number: int, task: Point | Path) -> _Result:
    """Run a point, or make a run again for its picture."""
    if isinstance(task, Path):
        # Only here: the process that is forked is smaller without what pictures need.
        resolve_name("stepbus_tools.sweep.row_run:plot_run")(options.home, number, task, None)
        return b"", "", []
    before = set(sys.modules)
    row, _ = trials.run(task, options.timeout_s)
    return row, "", [name for name in sys.modules if is_ours(name) and name not in before]


def _fork(children: _Children, number: int, work: Callable[[], _Result]) -> Connection:
    """Start a function in a copy of this process; return where its result comes."""
    source, sink = Pipe(duplex=False)
    parent, memory = os.getpid(), Heartbeat()
    if (pid := os.fork()) == 0:
        try:
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() == parent:
                heartbeat.own = memory
                try:
                    result = work()
                except Exception as exc:  # noqa: BLE001  (the caller reports it)
                    result = b"", str(exc) or error_text(exc), []
                sink.send(result)
        finally:
            os._exit(0)
    sink.close()
    children[source] = number, Watcher(memory, pid, is_owner=False)
    return source


def _answer(children: _Children, source: Connection) -> _Result:
    """Return the result of a copy, which ends with it; nothing where it has died."""
    _, watcher = children.pop(source)
    try:
        answer: _Result = source.recv()
    except (EOFError, OSError):
        answer = b"", "", []
    source.close()
    watcher.heartbeat.close()
    os.waitpid(watcher.pid, 0)  # no time-out: it ends after its result
    return answer


def _end(children: _Children) -> None:
    for source, (_, watcher) in list(children.items()):
        os.kill(watcher.pid, signal.SIGKILL)
        _answer(children, source)


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
    os._exit(0)
