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
import signal
import warnings
from collections.abc import Callable, Collection, Iterator

from stepbus_schemas import RunError

# Python 3.12 and later warn of a fork beside other threads: the copy has none of them, and waits
# without end for a lock that one of them held. The copy takes no lock of ours: it has neither
# signals nor finalizers, computes, writes into shared memory, and leaves by _exit. Memory is the C
# library's, which is whole after a fork. A step's deadline bounds one that stands still.
warnings.filterwarnings(
    "ignore", r".*multi-threaded, use of fork\(\)", DeprecationWarning, re.escape(__name__)
)

_PR_SET_PDEATHSIG = 1
_ALL = 2**31 - 1
_TEXT = 1000
_DONE, _FAILED = 1, 2


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

    def _work(self, work: Callable[[], bytes], parent: int, cores: Collection[int]) -> None:
        """Work, and end without any clean-up: what there is to clean up belongs to the parent."""
        try:
            # A finalizer would wait for threads that are not in the copy.
            gc.disable()
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
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
        """Wait for the bytes; raises RunError where there will be none."""
        code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])  # no time-out: of the step
        pid, self.pid = self.pid, 0
        state, data = self._memory[0], self._memory[1:]
        self._memory.close()
        if state == _DONE:
            return data[: self._size]
        if state == _FAILED:
            text = data[:_TEXT].partition(b"\0")[0].decode(errors="replace")
            raise RunError(f"{self._what}: {text}")
        how = f"was killed by {signal.Signals(-code).name}" if code < 0 else "has ended"
        raise RunError(f"{self._what}: process {pid}, which computed it, {how}")

    def end(self) -> None:
        """Kill the copy, unless its result was taken; harmless when repeated."""
        if self.pid:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)  # no time-out: it was killed
            self.pid = 0
            self._memory.close()


@contextlib.contextmanager
def _no_signals() -> Iterator[None]:
    """Keep signals back, so that no handler of this process ever runs in the copy."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
