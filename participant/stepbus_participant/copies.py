"""Lets a function work in a copy of this process, on another core, while this one goes on.

fork(2) makes the copy: it has all memory as it is at that moment, whichever library it belongs to.
The function returns bytes, and nothing else that it does reaches this process. The copy has no
open file, takes no signal but SIGKILL and SIGSTOP, and ends with the thread that has made it.
"""

import contextlib
import ctypes
import gc
import mmap
import os
import re
import select
import signal
import warnings
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from stepbus_schemas import RunError

# Python 3.12 and later warn of a fork beside other threads: the copy has none of them, and waits
# without end for a lock that one of them held. The copy takes no lock of ours: it has neither
# signals nor finalizers, computes, writes into shared memory, and leaves by _exit. Memory is the C
# library's, which is whole after a fork. One that stands still all the same is given up, below.
warnings.filterwarnings(
    "ignore", r".*multi-threaded, use of fork\(\)", DeprecationWarning, re.escape(__name__)
)

_PR_SET_PDEATHSIG = 1
_ALL = 2**31 - 1
_LOOK_MS = 250
_LOOKS = 8
"""A copy that has been seen so often in a row without having worked is given up: 2 s in all.

Counting looks, not time, tolerates a machine that slept (P12.1). The deadline of a step
is 3 s, so a participant that waits too long for a copy reports that itself.
"""
_TEXT = 1000
_DONE, _FAILED = 1, 2

_prctl: Any = getattr(ctypes.CDLL(None), "prctl", None)
"""Linux only: no other system makes copies."""


class Copy:
    """A copy of this process in which a function works.

    work: returns `size` bytes. what: it is called in errors. cores: it may run on. Raises OSError
    where the system allows no further process.
    """

    def __init__(
        self, work: Callable[[], bytes], size: int, what: str, cores: Collection[int]
    ) -> None:
        self._size, self._what = size, what
        self._memory = mmap.mmap(-1, 1 + max(size, _TEXT))
        parent = os.getpid()
        with _no_signals():
            self.pid = os.fork()
            if self.pid == 0:
                self._work(work, parent, cores)
        try:
            self._handle = os.pidfd_open(self.pid)
        except OSError:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)  # no time-out: it was killed
            raise

    def _work(self, work: Callable[[], bytes], parent: int, cores: Collection[int]) -> None:
        """Work, and end without any clean-up: what there is to clean up belongs to the parent."""
        try:
            # A finalizer would wait for threads that are not in the copy.
            gc.disable()
            _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() != parent:
                return
            os.closerange(0, _ALL)
            with contextlib.suppress(OSError):
                os.sched_setaffinity(0, cores)
            data = work()
            self._memory[1 : 1 + self._size] = data
            self._memory[0] = _DONE
        except BaseException as exc:  # noqa: BLE001  (it ends here, whatever it is)
            text = f"{type(exc).__name__}: {exc}".encode()[:_TEXT]
            self._memory[1 : 1 + len(text)] = text
            self._memory[0] = _FAILED
        finally:
            os._exit(0)

    def result(self) -> bytes:
        """Wait for the bytes, and end the copy; raises RunError where there will be none."""
        try:
            self._wait()
            return self._take()
        finally:
            self.end()

    def _wait(self) -> None:
        poll = select.poll()
        poll.register(self._handle, select.POLLIN)
        seen, looks = (0, ""), 0
        # no time-out: each look waits for one, and a copy that works is bounded by who waits
        while not poll.poll(_LOOK_MS):
            before, seen = seen, _activity(self.pid)
            looks = 0 if seen[0] != before[0] or seen[1] in "RD" else looks + 1
            if looks == _LOOKS:
                state = "is stopped" if seen[1] == "T" else "makes no progress"
                raise RunError(f"{self._what}: process {self.pid}, which computes it, {state}")

    def _take(self) -> bytes:
        if self._memory[0] == _DONE:
            return self._memory[1 : 1 + self._size]
        if self._memory[0] == _FAILED:
            text = self._memory[1 : 1 + _TEXT].partition(b"\0")[0].decode(errors="replace")
            raise RunError(f"{self._what}: {text}")
        code = 0
        with contextlib.suppress(ChildProcessError):
            code = os.waitstatus_to_exitcode(os.waitpid(self.pid, os.WNOHANG)[1])
        how = f"was killed by {signal.Signals(-code).name}" if code < 0 else "has ended"
        raise RunError(f"{self._what}: process {self.pid}, which computed it, {how}")

    def end(self) -> None:
        """Kill the copy, unless it has ended; harmless when repeated."""
        if self._handle < 0:
            return
        handle, self._handle = self._handle, -1
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(handle, signal.SIGKILL)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(self.pid, 0)  # no time-out: it was killed
        os.close(handle)
        self._memory.close()


@contextlib.contextmanager
def _no_signals() -> Iterator[None]:
    """Keep signals back, so that no handler of this process ever runs in the copy."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _activity(pid: int) -> tuple[int, str]:
    """Return how long a process has worked [ticks], and its state, as of proc_pid_stat(5)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0, ""
    return int(fields[11]) + int(fields[12]), fields[0]
