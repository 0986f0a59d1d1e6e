"""The connection of a view to a live run: its status and its calls."""

import contextlib
import math
import queue
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.run.live_file import LIVE_FILE, Line
from stepbus_schemas import StepbusError, WiringError

FRAME_S = 1 / 30
_STATUS_S = 0.4
_FLUSH_AGAIN_S = 2.0
_ANSWER_S = 10.0

Ask = tuple[str, str, Sequence[Any]]
"""Participant, or nothing for the run itself; method; arguments."""
_DRAGGED = frozenset({"set_target", "set_joint_position"})
"""Calls of sliders: while one is dragged, only the newest position counts."""


class RunClient:
    """Asks a run for its status and calls it, in a thread of its own.

    status: the newest one. offered: calls of participants. last: a sentence about the newest call.
    is_lost: the run does not answer.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._asked: queue.SimpleQueue[Ask | None] = queue.SimpleQueue()
        self.status: Mapping[str, Any] = {}
        self.offered: Mapping[str, Mapping[str, Any]] = {}
        self.last = ""
        self.is_lost = False
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._work, name="run client", daemon=True)
        self._thread.start()

    def ask(self, participant: str, method: str, *args: Any) -> None:
        """Ask the run, or a participant, for something; it is done in order."""
        self._asked.put((participant, method, args))

    def close(self) -> None:
        """Leave the run, which goes on."""
        self._over.set()
        self._asked.put(None)
        self._thread.join(_ANSWER_S)

    def _work(self) -> None:
        try:
            with Line(self._folder) as line:
                self._talk(line)
        except (StepbusError, OSError):
            # Without the file, the run has ended, or goes on in one process.
            self.is_lost = (self._folder / LIVE_FILE).exists()

    def _talk(self, line: Line) -> None:
        flushed_at = -math.inf
        try:
            while not self._over.is_set():
                if time.monotonic() - flushed_at > _FLUSH_AGAIN_S:
                    # It ends by itself when this process is killed, or when another viewer leaves.
                    flushed_at = time.monotonic()
                    line.call("", "flush", [FRAME_S], _ANSWER_S)
                self.status = line.call("", "status", (), _ANSWER_S).value or {}
                if not self.offered and self.status.get("phase") in {"stepping", "paused"}:
                    self.offered = line.call("", "", (), _ANSWER_S).value or {}
                for ask in newest(self._wait()):
                    self._call(line, ask)
        finally:
            with contextlib.suppress(StepbusError):
                line.call("", "flush", [None], _ANSWER_S)

    def _wait(self) -> list[Ask]:
        """Wait for requests; return all that have come."""
        asks: list[Ask | None] = []
        with contextlib.suppress(queue.Empty):
            asks.append(self._asked.get(timeout=_STATUS_S))
            while True:
                asks.append(self._asked.get_nowait())
        return [ask for ask in asks if ask is not None]

    def _call(self, line: Line, ask: Ask) -> None:
        participant, method, args = ask
        words = " ".join(map(str, (participant, method, *args))).strip()
        try:
            reply = line.call(participant, method, args)
        except WiringError as exc:
            self.last = f"{words}: refused: {exc}"
        else:
            if participant:
                self.last = f"{words}, before step {reply.step}"


def newest(asked: Sequence[Ask]) -> list[Ask]:
    """Return the requests without outdated positions of a dragged slider."""
    kept: list[Ask] = []
    for ask in asked:
        participant, method, args = ask
        before = kept[-1] if kept else ("", "", ())
        if method in _DRAGGED and (*before[:2], *before[2][:1]) == (participant, method, args[0]):
            kept.pop()
        kept.append(ask)
    return kept
