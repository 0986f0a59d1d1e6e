"""The connection of a view to a live run: its calls, and its recording as it grows."""

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Tail, layout
from stepbus_orchestrator.run.live_file import LIVE_FILE, Line
from stepbus_schemas import StepbusError, WiringError
from stepbus_tools.viewing.scene.scene import Latest, Messages

FRAME_S = 1 / 30
IDLE_S = 5.0
"""So long without anything new, and a run has been killed, or its user is told."""
_START_S = 600.0
_STATUS_S = 0.4
_FLUSH_AGAIN_S = 2.0
_ANSWER_S = 10.0

Ask = tuple[str, str, Sequence[Any]]
"""Participant, or nothing for the run itself; method; arguments."""
Turn = Callable[[bool], None]
"""Shows what is new, thirty times a second. It takes whether anything has been recorded since."""

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
        """Wait for what is asked, and return all of it."""
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
    """Return what is asked, without positions of a slider that has been dragged on since."""
    kept: list[Ask] = []
    for ask in asked:
        participant, method, args = ask
        before = kept[-1] if kept else ("", "", ())
        if method in _DRAGGED and (*before[:2], *before[2][:1]) == (participant, method, args[0]):
            kept.pop()
        kept.append(ask)
    return kept


def latest_of(tail: Tail, topics: Iterable[str]) -> Messages:
    """Return the newest message of each port that has one to read."""
    return {topic: Latest(*row) for topic in topics if (row := tail.latest(topic)) is not None}


def follow_run(
    folder: Path, is_over: Callable[[], bool], begin: Callable[[Tail, RunClient], Turn]
) -> bool:
    """Show a run until it has ended, or the viewer has; returns whether the run has ended.

    folder: of the run, which may not have begun. begin: takes its recording, which has its first
    messages, and the connection to it. Raises RecordingFailed when it does not begin.
    """
    with contextlib.ExitStack() as stack:
        tail = _wait_for(folder, is_over, stack)
        if tail is None:
            return False
        client = RunClient(folder)
        stack.callback(client.close)
        turn = begin(tail, client)
        # The first messages are there.
        is_new, grown_at = True, time.monotonic()
        while not is_over() and not tail.is_complete:
            began = time.monotonic()
            is_new = tail.poll() or is_new
            turn(is_new)
            grown_at = began if is_new else grown_at
            if client.is_lost and began - grown_at > IDLE_S:
                # It was killed: what it has recorded is shown.
                break
            is_new = False
            time.sleep(max(0.0, FRAME_S - (time.monotonic() - began)))
        turn(tail.poll() or is_new)
        return not is_over()


def _wait_for(
    folder: Path, is_over: Callable[[], bool], stack: contextlib.ExitStack
) -> Tail | None:
    """Return the recording of a run as soon as it has messages; None when the viewer has ended."""
    deadline, path, tail = time.monotonic() + _START_S, folder / layout.RUN_FILE, None
    while not is_over():
        if tail is None and path.exists():
            tail = Tail(path)
            stack.callback(tail.close)
        if tail is not None and tail.poll() and tail.last_step >= 0:
            return tail
        if tail is not None and tail.is_complete:
            raise RecordingFailed(f"{path} has no messages; nothing to show")
        if time.monotonic() > deadline:
            raise RecordingFailed(f"{folder}: no run has started there for {_START_S:.0f} s")
        time.sleep(FRAME_S)
    return None
