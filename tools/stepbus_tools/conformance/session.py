"""One started program and the bus around it: records what it sends, and every wait ends."""

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Self

from stepbus_orchestrator.errors import Interrupted
from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.processes.endpoints import new_token
from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.processes.watchdog import Watchdog
from stepbus_orchestrator.run.bus import open_bus
from stepbus_participant import Endpoint, Request, Sample, ZenohBus
from stepbus_schemas import Refusal, encode, encoding_of
from stepbus_tools.conformance.feeds import SharedSlots
from stepbus_tools.conformance.material import Material, Setup
from stepbus_tools.conformance.outcome import Failed
from stepbus_tools.conformance.transcript import Transcript

_DRAIN_S = 5.0
_TICK_S = 0.02
# The last messages of a process may arrive a little after its end.
_LAST_LINES_S = 0.1
# After this time, a query that did not reach all who reply on `join` is dropped, and repeated.
_ROUND_S = 0.5
# Each link has its own order: replies on two of them keep theirs where they are this far apart.
_APART_S = 0.05
_WELCOME = b""
_REPLIES = (
    b"garbage",
    encode(Refusal(reason="another process refuses you")),
    _WELCOME,
    # Behind the Welcome, whose place it takes for a program that lets Zenoh consolidate replies.
    encode(Refusal(reason="another process refuses you again")),
)
"""The replies on `join` of the peers' end and of the orchestrator, in their order."""


class Session:
    """One started program, and both ends of the bus; a context that ends whatever it started.

    material: what is played. command: the program's command line. cwd: where it is started. logs:
    gets its log. child: its process, once it is started. transcript: what it has sent. Every wait
    raises Failed when its deadline is over, when the program has ended, or when it reports a fault
    that the check does not expect.
    """

    child: Child

    def __init__(
        self,
        *,
        material: Material,
        setup: Setup,
        command: Sequence[str],
        cwd: Path,
        logs: Path,
        interrupt: threading.Event,
    ) -> None:
        self.token = new_token()
        self.material = material
        self.scenario = setup.scenario(material.scenario, material.spec.name)
        self.spec = self.scenario.participant(material.spec.name)
        self.transcript = Transcript(
            self.spec, self.token, self.scenario.step_ns, self.scenario.types
        )
        self._setup = setup
        self._command, self._cwd, self._logs = command, cwd, logs
        self._interrupt = interrupt
        self._run = new_token()
        self._inbox: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._stack = contextlib.ExitStack()
        self._peers: dict[str, Callable[..., None]] = {}
        self._bulk: dict[str, dict[str, Callable[..., None]]] = {}
        self._control: dict[str, Callable[..., None]] = {}
        self._queries: dict[bytes, Request] = {}
        self._queried_at = 0.0
        self._replies: tuple[bytes, ...] = (_WELCOME,)
        self._bus: ZenohBus | None = None

    # --- opening and closing -----------------------------------------------------------------

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            self._launcher = Launcher(run=self._run, token=self.token, logs=self._logs)
            stack.callback(self._launcher.end_all)
            limit_s = self.spec.deadlines.step_s
            self._watchdog = Watchdog(limit_s, lambda: self.child.signal(signal.SIGKILL))
            stack.callback(self._watchdog.close)
            self._slots: SharedSlots | None = None
            if self._setup.has_slots:
                folder = self._launcher.folder / "slots"
                self._slots = SharedSlots(folder, self.scenario, self.spec)
                self.transcript.read_slot = self._slots.read
                stack.callback(self._slots.close)
            self._mesh = self._setup.mesh(self.scenario, self.spec, self._launcher.folder, stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_error: object) -> None:
        self._stack.close()

    def open_bus(self) -> None:
        """Open the orchestrator's end of the bus."""
        bus = self._bus = self._open(self._mesh.orchestrator)
        name, transcript, put = self.spec.name, self.transcript, self._inbox.put

        def record(channel: str, sample: Sample) -> None:
            put(partial(transcript.add, channel, sample.payload, sample.encoding))

        def record_bulk(port: str, sample: Sample) -> None:
            content = sample.attachment, sample.payload, sample.encoding
            put(partial(transcript.add_bulk, port, *content))

        bus.answer("join", partial(self._take_query, _WELCOME))
        for channel in ("out", "log", "ready", "fault"):
            bus.subscribe(f"{channel}/{name}", partial(record, channel))
        for port, output in self.spec.outputs.items():
            if output.bulk:
                bus.subscribe(f"bulk/{name}/{port}", partial(record_bulk, port))
        bus.watch_alive(
            f"alive/{name}",
            lambda _, is_alive: put(partial(setattr, transcript, "alive", is_alive)),
        )
        for channel in ("start", "trigger", "stop"):
            self._control[channel] = bus.publisher(channel, encoding_of(f"{channel.title()}/1"))
        bus.declare_alive("alive/orchestrator")
        if not self._setup.own_peers:
            self._open_publishers(bus)

    def open_peers(self, *, replying: bool = False) -> None:
        """Open the peers' own end of the bus; replying: wrongly on `join`, around the `Welcome`."""
        names = [name for name in self._mesh.participants if name != self.spec.name]
        if names:
            bus = self._open(self._mesh.participants[names[0]])
            self._open_publishers(bus)
            if replying:
                self._replies = _REPLIES
                for reply in set(_REPLIES) - {_WELCOME}:
                    bus.answer("join", partial(self._take_query, reply))

    def _open(self, endpoint: Endpoint) -> ZenohBus:
        bus = open_bus(endpoint, self._run)
        self._stack.callback(bus.close)
        return bus

    def _open_publishers(self, bus: ZenohBus) -> None:
        for source in self.material.feed:
            self._peers[source] = bus.publisher(f"out/{source}", encoding_of("Outputs/1"))
            self._bulk[source] = {
                port: bus.publisher(f"bulk/{source}/{port}", encoding_of(output.type))
                for port, output in self.scenario.participant(source).outputs.items()
                if output.bulk
            }

    def start_program(self) -> None:
        """Start the participant."""
        self.child = self._launcher.start(
            self.spec,
            self._command,
            self._mesh.participants[self.spec.name],
            self._cwd,
            slots="" if self._slots is None else str(self._slots.folder),
            protocols=self._setup.protocols,
        )
        self._stack.callback(self.child.signal, signal.SIGKILL)

    def leave(self) -> None:
        """Close the bus without a Stop, as a killed orchestrator does."""
        if self._bus is not None:
            with self._watchdog.watching():
                self._bus.close()
            # This session no longer hears when its token disappears.
            self.transcript.alive = False

    # --- admission ---------------------------------------------------------------------------

    def drop_queries(self) -> None:
        """Drop a query that did not reach all who reply; the program repeats it."""
        if time.monotonic() - self._queried_at > _ROUND_S:
            self._queries.clear()

    def _take_query(self, reply: bytes, request: Request) -> None:
        self._inbox.put(partial(self._on_query, reply, request))

    def _on_query(self, reply: bytes, request: Request) -> None:
        """Keep a query until it has reached all who reply; then they do, in their order."""
        self._queries[reply], self._queried_at = request, time.monotonic()
        if len(self._queries) == len(self._replies):
            for each in self._replies:
                self._reply(each, self._queries.pop(each))

    def _reply(self, reply: bytes, request: Request) -> None:
        if reply == _WELCOME:
            self._admit(request)
            return
        time.sleep(_APART_S)
        request.reply(reply, encoding_of("Refusal/1"))
        time.sleep(_APART_S)

    def _admit(self, request: Request) -> None:
        self.transcript.add_hello(request.payload)
        answer = self._setup.answer(self.scenario, self.spec, self.token)
        request.reply(encode(answer), encoding_of(f"{type(answer).__name__}/1"))

    # --- waiting -----------------------------------------------------------------------------

    def poll(self, timeout_s: float = _TICK_S) -> bool:
        """Process what has arrived; return whether anything did within a time [s]."""
        try:
            self._inbox.get(timeout=timeout_s)()
        except Empty:
            return False
        for _ in range(self._inbox.qsize()):
            self._inbox.get()()  # no time-out: it is not empty
        return True

    def idle(self, duration_s: float) -> None:
        """Process what arrives for some time [s]."""
        end = time.monotonic() + duration_s
        while (left_s := end - time.monotonic()) > 0:
            self.poll(left_s)

    def _wait(
        self, condition: Callable[[], object], timeout_s: float, tick: Callable[[], None] | None
    ) -> None:
        """Wait for a condition, or until a time is over; tick: repeated meanwhile."""
        end = time.monotonic() + timeout_s
        while not condition() and time.monotonic() <= end:
            if self._interrupt.is_set():
                raise Interrupted("interrupted")
            if not self.poll() and tick is not None:
                tick()

    def until(
        self,
        condition: Callable[[], object],
        what: str,
        timeout_s: float,
        tick: Callable[[], None] | None = None,
        *,
        faults: bool = False,
    ) -> None:
        """Wait for a condition; tick: repeated meanwhile. faults: whether it may report one."""
        transcript = self.transcript

        def is_over() -> bool:
            return self.child.exit_code() is not None or bool(transcript.faults and not faults)

        self._wait(lambda: condition() or is_over(), timeout_s, tick)
        while not condition() and self.child.exit_code() is not None and self.poll(_LAST_LINES_S):
            continue
        if condition():
            return
        if transcript.faults and not faults:
            fault = transcript.faults[0]
            raise Failed(f"it reported a fault at step {fault.step}: {fault.message}")
        how = f" within {timeout_s:g} s{self._last_wait()}"
        if self.child.exit_code() is not None:
            how = f": it {self.child.how_it_ended()}{self.last_output()}"
        # What else is wrong may be the cause.
        problem = next((f"; {text} ({c})" for c, text in transcript.problems.items()), "")
        raise Failed(f"{what} did not arrive{how}{problem}")

    def _last_wait(self) -> str:
        waiting = self.transcript.logs[-1].waiting if self.transcript.logs else None
        if waiting is None:
            return self.last_output()
        who = ", ".join(waiting.sources) or "the trigger"
        return f"; it reports that it is waiting for {who} at step {waiting.step}"

    # --- the program's end -------------------------------------------------------------------

    def last_output(self) -> str:
        """Return its last lines, as the end of a sentence."""
        output = self.child.last_output()
        return f"; its last output: {output}" if output else ""

    def await_end(self, what: str, timeout_s: float, tick: Callable[[], None] | None = None) -> int:
        """Return the exit code once the program has ended; what: after which event."""
        self._wait(lambda: self.child.exit_code() is not None, timeout_s, tick)
        if self.child.exit_code() is None:
            raise Failed(f"it did not end within {timeout_s:g} s of {what}")
        # Its liveliness token disappears behind the last of what it sent, on the same link.
        self._wait(lambda: not self.transcript.alive, _DRAIN_S, None)
        while self.poll(0.0):
            continue
        return self.child.exit_code() or 0
