"""The process of which each run of a sweep on this machine is a fork.

`python -P -m stepbus_tools.sweep.fork_server DESCRIPTOR` is sent a bundle and the options of a
sweep, and answers with an error or an empty text. Then it is sent points; each answer is the number
of a run, its row as JSON (empty where its process has died) and its error. None is answered by
None. It ends with the other end of the connection.
"""

import contextlib
import ctypes
import gc
import os
import signal
import sys
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection, Pipe, wait
from pathlib import Path
from pkgutil import resolve_name

from stepbus_participant import is_ours
from stepbus_schemas import error_text
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.pool import PoolOptions, run_point
from stepbus_tools.sweep.row_run import plot_run
from stepbus_tools.sweep.trial import Trials

_PR_SET_PDEATHSIG = 1


def serve(channel: Connection) -> None:
    """Fork a process for each point, until the other end is closed."""
    bundle, options = channel.recv()
    children: dict[Connection, tuple[int, int]] = {}
    with contextlib.suppress(EOFError, OSError), contextlib.ExitStack() as stack:
        try:
            trials = stack.enter_context(Trials(bundle, keep=options.keep, home=options.home))
            # Before its folder is removed, in which they write.
            stack.callback(_end, children)
            error = _load(trials, channel, children)
        except EOFError:
            return
        except Exception as exc:  # noqa: BLE001  (the caller reports it)
            error = str(exc) or error_text(exc)
        channel.send(error)
        while not error:
            ready = wait([channel, *children])
            for source in [source for source in children if source in ready]:
                pid, number = children.pop(source)
                channel.send((number, *_answer(source, pid)))
            if channel in ready:
                match channel.recv():
                    case None:
                        channel.send(None)
                    case Point() as point:
                        source, pid = _fork(partial(_run, trials, point, options))
                        children[source] = pid, point.number
                    case number, picture:
                        source, pid = _fork(partial(_plot, options, number, picture))
                        children[source] = pid, number


def _load(trials: Trials, channel: Connection, children: dict[Connection, tuple[int, int]]) -> str:
    """Load what the runs need; return why they cannot have it, or an empty text.

    The user's metrics are tried in a fork: one that starts a thread is loaded by each run, since a
    process with threads must not fork. Raises EOFError where the other end is closed meanwhile.
    """
    for name in filter(is_ours, trials.classes()):
        # A run that needs it says what is wrong.
        with contextlib.suppress(Exception):
            resolve_name(name)
    source, pid = _fork(lambda: (_threads(trials), ""))
    children[source] = pid, -1
    if channel in wait([channel, source]):
        raise EOFError
    threads, error = _answer(source, children.pop(source)[0])
    if threads == b"1":
        trials.load_metrics()
    # A child that changes the count of references to something copies its page.
    gc.freeze()
    return error or ("" if threads else "a metric has ended its process")


def _threads(trials: Trials) -> bytes:
    trials.load_metrics()
    return str(len(os.listdir("/proc/self/task"))).encode()  # noqa: PTH208  (a list of the kernel's)


def _run(trials: Trials, point: Point, options: PoolOptions) -> tuple[bytes, str]:
    return run_point(trials, point, options)[0], ""


def _plot(options: PoolOptions, number: int, picture: Path) -> tuple[bytes, str]:
    plot_run(options.home, number, picture, None)
    return b"", ""


def _fork(work: Callable[[], tuple[bytes, str]]) -> tuple[Connection, int]:
    """Start a function in a copy of this process; return where its result comes, and its id."""
    source, sink = Pipe(duplex=False)
    parent = os.getpid()
    if (pid := os.fork()) == 0:
        try:
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() == parent:
                try:
                    result = work()
                except Exception as exc:  # noqa: BLE001  (the caller reports it)
                    result = b"", str(exc) or error_text(exc)
                sink.send(result)
        finally:
            os._exit(0)
    sink.close()
    return source, pid


def _answer(source: Connection, pid: int) -> tuple[bytes, str]:
    """Return the result of a copy, which ends with it; nothing where it has died."""
    try:
        answer: tuple[bytes, str] = source.recv()
    except (EOFError, OSError):
        answer = b"", ""
    source.close()
    os.waitpid(pid, 0)  # no time-out: it ends after its result
    return answer


def _end(children: dict[Connection, tuple[int, int]]) -> None:
    for pid, _ in children.values():
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)  # no time-out: it was killed


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
    os._exit(0)
