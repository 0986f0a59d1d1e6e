"""One started program, and the run around it: plays its orchestrator and all of its peers."""

import contextlib
import dataclasses
import signal
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Self

import msgspec

from stepbus_orchestrator.errors import Interrupted
from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.processes.endpoints import make_mesh, new_token
from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.run.bus import Session, open_bus
from stepbus_orchestrator.run.kernel.admission import welcome_of
from stepbus_orchestrator.run.player import Player, Ports
from stepbus_participant import Endpoint, Request, ZenohBus
from stepbus_schemas import Batch, Description, Fault, Refusal, Start, due_step, encode, encoding_of
from stepbus_tools.conformance.material import Feed, Material, Setup
from stepbus_tools.conformance.slots import SharedSlots
from stepbus_tools.conformance.transcript import Failed, Transcript

Hook = Callable[["Harness", int], None]
"""An action at a step, in addition to those of a plain run."""

_DRAIN_S = 5.0
_TICK_S = 0.02
# The last messages of a process may arrive a little after its end.
_LAST_LINES_S = 0.1
# After this time, a query that did not reach every queryable on `join` is dropped, and repeated.
_ROUND_S = 0.5
# Each link has its own order: replies on two of them keep theirs where they are this far apart.
_APART_S = 0.05
_WELCOME = b""
_REPLIES = (
    b"garbage",
    encode(Refusal(reason="another process refuses you")),
    _WELCOME,
    # After the Welcome, whose place it takes for a program that lets Zenoh consolidate replies.
    encode(Refusal(reason="another process refuses you again")),
)
"""The replies on `join` of the peers' end and of the orchestrator, in their order."""


def _nothing(_harness: "Harness", _step: int) -> None: ...


class Harness:
    """One started program, and both ends of the bus; a context that ends both.

    material: the played messages. command: the program's command line. cwd: where it is started.
    logs: gets its log. child: its process, once it is started. transcript: all messages it has
    sent. session: the orchestrator's end of the bus, once it is open. control: channel → publishes
    bytes on it. player: plays the peers, once their end is open.

    Every wait raises Failed when its deadline is over, when the program has ended or reads nothing,
    or when it reports a fault that the check does not expect.
    """

    child: Child
    session: Session
    player: Player

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
        self.control: dict[str, Callable[[bytes], None]] = {}
        self._setup = setup
        self._command, self._cwd, self._logs = command, cwd, logs
        self._interrupt = interrupt
        self._run = new_token()
        self._queries: dict[bytes, Request] = {}
        self._queried_at = 0.0
        self._replies: tuple[bytes, ...] = (_WELCOME,)
        self._slots: SharedSlots | None = None
        self._is_blocked = False

    # --- opening and closing -----------------------------------------------------------------

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            self._launcher = Launcher(run=self._run, token=self.token, logs=self._logs)
            stack.callback(self._launcher.end_all)
            if self._setup.has_slots:
                folder = self._launcher.folder / "slots"
                self._slots = SharedSlots(folder, self.scenario, self.spec)
                self.transcript.read_slot = self._slots.read
                stack.callback(self._slots.close)
            linked = self._setup.linked(self.scenario, self.spec)
            self._mesh = make_mesh(linked, self._launcher.folder, None, stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_error: object) -> None:
        self._stack.close()

    def open_bus(self) -> None:
        """Open the orchestrator's end of the bus."""
        session = self.session = self._open(self._mesh.orchestrator)
        bus, into = session.bus, session.inbox.into
        name, transcript = self.spec.name, self.transcript
        bus.answer("join", into(partial(self._on_query, _WELCOME)))
        for channel in ("out", "log", "ready", "fault"):
            bus.subscribe(f"{channel}/{name}", into(partial(transcript.add, channel)))
        for port, output in self.spec.outputs.items():
            if output.bulk:
                bus.subscribe(f"bulk/{name}/{port}", into(partial(transcript.add_bulk, port)))
        alive = into(partial(setattr, transcript, "alive"))
        bus.watch_alive(f"alive/{name}", lambda _, is_alive: alive(is_alive))
        for channel in ("start", "trigger", "stop"):
            self.control[channel] = session.publisher(channel, f"{channel.title()}/1")
        bus.declare_alive("alive/orchestrator")
        if not self._setup.own_peers:
            self._play(session)

    def open_peers(self, *, replying: bool = False) -> None:
        """Open the peers' own end of the bus; replying: wrongly on `join`, around the `Welcome`."""
        names = [name for name in self._mesh.participants if name != self.spec.name]
        for name in names[:1]:
            peers = self._open(self._mesh.participants[name])
            self._play(peers)
            if replying:
                self._replies = _REPLIES
                for reply in set(_REPLIES) - {_WELCOME}:
                    take = self.session.inbox.into(partial(self._on_query, reply))
                    peers.bus.answer("join", take)

    def _open(self, endpoint: Endpoint) -> Session:
        bus: ZenohBus = open_bus(endpoint, self._run)
        self._stack.callback(bus.close)
        alone = dataclasses.replace(self.scenario, participants=(self.spec,))
        session = Session(alone, bus, self.token, self._kill)
        self._stack.callback(session.close)
        return session

    def _play(self, session: Session) -> None:
        specs = map(self.scenario.participant, self.material.feed)
        self.player = Player(specs, self.scenario.step_ns, self.token, session.publisher)

    def _kill(self) -> None:
        """End the program, which reads nothing: a put to it blocks."""
        self._is_blocked = True
        self.child.signal(signal.SIGKILL)

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
        self.session.bus.close()
        # This session no longer hears when its token disappears.
        self.transcript.alive = False

    # --- admission ---------------------------------------------------------------------------

    def drop_queries(self) -> None:
        """Drop a query that did not reach every queryable; the program repeats it."""
        if time.monotonic() - self._queried_at > _ROUND_S:
            self._queries.clear()

    def _on_query(self, reply: bytes, request: Request) -> None:
        """Keep a query until it has reached every queryable; then they reply, in their order."""
        self._queries[reply], self._queried_at = request, time.monotonic()
        if len(self._queries) < len(self._replies):
            return
        for each in self._replies:
            query = self._queries.pop(each)
            if each == _WELCOME:
                self.transcript.add_hello(query.payload)
                welcome = welcome_of(self.scenario, self.spec, self.token)
                self.session.reply(query, self._setup.answer(welcome))
            else:
                time.sleep(_APART_S)
                query.reply(each, encoding_of("Refusal/1"))
                time.sleep(_APART_S)

    # --- sending -----------------------------------------------------------------------------

    def start(self, descriptions: Mapping[str, Description] | None = None) -> None:
        """Send `Start`, with the descriptions of the participant's inputs."""
        own = dict(self.material.descriptions if descriptions is None else descriptions)
        slots = {} if self._slots is None else dict(self._slots.agree(self.transcript.readies[-1]))
        start = Start(token=self.token, inputs={self.spec.name: own}, slots=slots)
        self.session.start(encode(start))

    def release(self, step_limit: int) -> None:
        """Allow all steps below `step_limit`."""
        self.session.trigger(step_limit)

    def repeat(self) -> None:
        """Send the newest start and trigger again, when it is time to: they may have been lost."""
        self.session.repeat(with_start=not self.transcript.outputs)

    def stop(self, at_step: int) -> None:
        """Send `Stop`."""
        self.session.stop("the check ends", at_step)

    def publish(self, source: str, step: int, ports: Ports, late: int = 0) -> None:
        """Publish the outputs of a source at a step; late: as of `SharedSlots.write`."""
        outputs, content = self.outputs(source, step, ports, late=late)
        for port, data in content.items():
            self.player.publish_content(source, port, step, data)
        self.player.puts[source](outputs)

    def publish_batch(self, source: str, rows: Mapping[int, Ports]) -> None:
        """Publish the outputs of a source at several steps at once; none has bulk content."""
        entries = [msgspec.Raw(self.outputs(source, step, row)[0]) for step, row in rows.items()]
        self.player.puts[source](encode(Batch(token=self.token, outputs=entries)))

    def outputs(
        self, source: str, step: int, ports: Ports, token: str | None = None, late: int = 0
    ) -> tuple[bytes, dict[str, bytes]]:
        """Return the `Outputs` of a source at a step, and the content that travels in messages.

        Content for slots is written. token: default: that of the run. late: as of
        `SharedSlots.write`.
        """
        outputs, content = self.player.outputs(source, step, ports, token)
        if self._slots is not None:
            outputs, content = self._slots.write(source, outputs, content, late)
        return encode(outputs), content

    def feed(self, feed: Feed, step: int) -> None:
        """Publish the outputs of all sources at a step."""
        for source, rows in feed.items():
            if step in rows and step % self.scenario.participant(source).every == 0:
                self.publish(source, step, rows[step])

    # --- waiting -----------------------------------------------------------------------------

    def poll(self, timeout_s: float = _TICK_S) -> bool:
        """Process the messages that have arrived; return whether any did within a time [s]."""
        if not self.control:
            # The bus is not open yet.
            time.sleep(timeout_s)
            return False
        return self.session.inbox.receive(timeout_s)

    def idle(self, duration_s: float) -> None:
        """Process the messages that arrive for some time [s]."""
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
            if self._is_blocked:
                limit_s = self.spec.deadlines.step_s
                raise Failed(f"it read no messages for {limit_s:g} s while they queued up")
            if not self.poll() and tick is not None:
                tick()

    def until(
        self,
        condition: Callable[[], object],
        what: str,
        timeout_s: float = 0.0,
        tick: Callable[[], None] | None = None,
        *,
        faults: bool = False,
    ) -> None:
        """Wait for a condition; tick: repeated meanwhile. faults: whether it may report one.

        timeout_s: default: the deadline for a step.
        """
        transcript, timeout_s = self.transcript, timeout_s or self.spec.deadlines.step_s

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

    def fault_during(self, play: Callable[[], None]) -> Fault | None:
        """Return the fault that it reports meanwhile, if any; raises other failures."""
        try:
            play()
        except Failed:
            if not self.transcript.faults:
                raise
        return next(iter(self.transcript.faults), None)

    def _last_wait(self) -> str:
        waiting = self.transcript.logs[-1].waiting if self.transcript.logs else None
        if waiting is None:
            return self.last_output()
        who = ", ".join(waiting.sources) or "the trigger"
        return f"; it reports that it is waiting for {who} at step {waiting.step}"

    def last_output(self) -> str:
        """Return its last lines of output, as the end of an error message."""
        output = self.child.last_output()
        return f"; its last output: {output}" if output else ""

    def await_join(self) -> None:
        """Wait until it has asked to join."""
        limits = self.spec.deadlines
        self.until(
            lambda: self.transcript.asked, "a request to join", limits.spawn_s + limits.join_s
        )

    def await_ready(self) -> None:
        """Exchange handshakes with it until it is ready."""
        self.player.send_handshake()
        limit_s = self.spec.deadlines.ready_s
        self.until(lambda: self.transcript.readies, "Ready", limit_s, self.player.send_handshake)

    def await_output(self, step: int, *, repeating: bool = True) -> None:
        """Wait until it has published the newest step it fires at, up to `step`.

        repeating: whether the trigger is repeated meanwhile.
        """
        due = due_step(step, every=self.spec.every)
        has_bulk = any(output.bulk for output in self.spec.outputs.values())
        self.until(
            lambda: self.transcript.newest >= due and not self.transcript.awaited,
            f"step {due}, with all that it announces," if has_bulk else f"step {due}",
            tick=self.repeat if repeating else None,
        )

    def await_logged(self, count: int | None = None) -> None:
        """Wait until `count` outputs have been logged; default: all it has published."""
        transcript, every = self.transcript, self.spec.every
        wanted = len(transcript.packed) if count is None else count
        step = transcript.newest if count is None else (count - 1) * every
        self.until(
            lambda: len(transcript.logged) >= wanted, f"the log of step {step}", tick=self.repeat
        )

    def await_end(self, what: str, timeout_s: float, tick: Callable[[], None] | None = None) -> int:
        """Return the exit code once the program has ended; what: the event before, for messages."""
        self._wait(lambda: self.child.exit_code() is not None, timeout_s, tick)
        if self.child.exit_code() is None:
            raise Failed(f"it did not end within {timeout_s:g} s of {what}")
        # Its liveliness token disappears after the last of what it sent, on the same link.
        self._wait(lambda: not self.transcript.alive, _DRAIN_S, None)
        while self.poll(0.0):
            continue
        return self.child.exit_code() or 0

    # --- stepping ----------------------------------------------------------------------------

    def walk(
        self, feed: Feed, first: int, end: int, *, before: Hook = _nothing, after: Hook = _nothing
    ) -> None:
        """Do the steps from `first` to below `end` in lockstep.

        before, after: are done before and after the inputs of a step.
        """
        for step in range(first, end):
            self.release(step + 1)
            before(self, step)
            self.feed(feed, step)
            after(self, step)
            self.await_output(step)

    def follow(self, feed: Feed) -> None:
        """Do all steps as a run does: as far ahead of what is logged as the window allows."""
        fed, steps, logged = 0, self.material.steps, self.transcript.logged
        while (done := len(logged) * self.spec.every) < steps:
            step_limit = min(steps, done + self.scenario.window)
            for step in range(fed, step_limit):
                self.feed(feed, step)
            fed = max(fed, step_limit)
            self.release(step_limit)
            self.await_logged(len(logged) + 1)
