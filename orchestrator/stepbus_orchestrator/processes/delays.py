"""Delays participants at random, to bring races to light."""

import contextlib
import random
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence

from stepbus_orchestrator.processes.child import Child

_LONGEST_PAUSE_S = 0.02
_LONGEST_DELAY_S = 0.01
_JOIN_S = 1.0


class Delays:
    """Stops every participant again and again for up to 10 ms, each at times of its own.

    SIGSTOP and SIGCONT come from outside: they work for a program in any language, hit it between
    any two instructions and cannot change its messages. So whatever changes in the recording is a
    race of the participant's own.

    names: the participants. seed: of the pauses and delays. counts: how often each was stopped.
    Use `around` as `Options.around`.
    """

    def __init__(self, names: Sequence[str], seed: Sequence[int]) -> None:
        self.counts = dict.fromkeys(names, 0)
        self._seed = list(seed)
        self._over = threading.Event()

    @contextlib.contextmanager
    def around(self, children: Mapping[str, Child]) -> Iterator[None]:
        """Delay the participants, which appear in `children` as they are started."""
        threads = [
            threading.Thread(target=self._disturb, args=(children, index, name), daemon=True)
            for index, name in enumerate(self.counts)
        ]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            self._over.set()
            for thread in threads:
                thread.join(_JOIN_S)

    def _disturb(self, children: Mapping[str, Child], index: int, name: str) -> None:
        generator = random.Random(repr([*self._seed, index]))  # noqa: S311  (delays, no secret)
        while not self._over.wait(generator.uniform(0, _LONGEST_PAUSE_S)):
            child = children.get(name)
            if child is not None and child.exit_code() is None:
                self._delay(child, generator.uniform(0, _LONGEST_DELAY_S))
                self.counts[name] += 1

    def _delay(self, child: Child, delay_s: float) -> None:
        child.signal(signal.SIGSTOP)
        try:
            self._over.wait(delay_s)
        finally:
            child.signal(signal.SIGCONT)
