"""A host whose processes are simulated: the third, beside `Processes` and `InProcess`."""

import contextlib
import signal
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from stepbus_orchestrator.processes.activity import Activity
from stepbus_orchestrator.processes.child import Process as RunProcess
from stepbus_orchestrator.run.extension import RunView, Strategy
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import (
    HOST,
    Bus,
    Clock,
    Disk,
    Endpoint,
    Host,
    Ticket,
    import_participant,
    main,
)
from stepbus_schemas import SPOKEN

from .disk import SimulatedDisk
from .network import Network, Node
from .world import Process, World

_PAUSE_S = 0.005
_START_NS = 20_000_000
"""How long a process takes from its start to its first line."""


class SimulatedParticipant(RunProcess):
    """A participant's process, as a run sees it. errors: what it has printed."""

    def __init__(self, process: Process, pid: int, log: Path) -> None:
        super().__init__(log)
        self.process = process
        self.pid = pid
        self.errors = ""

    def exit_code(self) -> int | None:
        """Return its exit code, negative for a signal; None while it runs."""
        return self.process.exit_code

    def last_output(self) -> str:
        """Return the last line that it printed."""
        return (self.errors.strip().splitlines() or [""])[-1]

    def activity(self) -> Activity:
        """Return whether it is stopped."""
        return Activity(is_stopped=self.process.is_frozen and not self.process.is_dead)

    def signal(self, number: int) -> None:
        """Send it a signal."""
        if number == signal.SIGSTOP:
            self.process.freeze()
        elif number == signal.SIGCONT:
            self.process.world.after(0, self.process.thaw)
        elif number == signal.SIGKILL or not self.process.is_frozen:
            self.process.kill(-number)

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has ended within a time [s]."""
        clock = self.process.world.current().clock
        until = clock.monotonic() + timeout_s
        while not self.process.is_dead and clock.monotonic() < until:
            clock.sleep(_PAUSE_S)
        return self.process.is_dead

    def terminate(self) -> None:
        """Ask it once to end; one that is stopped does not hear it."""
        self.signal(signal.SIGTERM)

    def end(self, grace_s: float = 0.0) -> None:
        """Terminate it, then kill it. grace_s: between the two."""
        self.terminate()
        self.wait(grace_s)
        self.process.kill(-signal.SIGKILL)


class SimulatedHost:
    """Hosts a run in a world.

    orchestrator: the process that runs it. wrap: gets the name and the class of each participant,
    and returns what makes it. start_order: those that are started; empty: all, as in the scenario.
    is_star: they are linked to the orchestrator only. on_call: name of a process → number of a call
    → what happens before it.
    """

    def __init__(
        self,
        network: Network,
        orchestrator: Process,
        disk: SimulatedDisk,
        wrap: Callable[[str, Any], Any] = lambda _name, make: make,
    ) -> None:
        self.network = network
        self.orchestrator = orchestrator
        self.clock: Clock = orchestrator.clock
        self.disk: Disk = disk
        self.wrap = wrap
        self.start_ns: dict[str, int] = {}
        self.lies: dict[str, int] = {}
        self.linger_ns: dict[str, int] = {}
        self.start_order: list[str] = []
        self.is_star = False
        self.participants: dict[str, SimulatedParticipant] = {}
        self.on_call: dict[str, dict[int, Callable[[], None]]] = defaultdict(dict)
        orchestrator.on_call = self.on_call[orchestrator.name]

    @property
    def world(self) -> World:
        """Return its world."""
        return self.network.world

    def check(self, scenario: Scenario) -> None:
        """Do nothing: every scenario runs here."""

    @contextlib.contextmanager
    def open(self, run: RunView) -> Iterator[tuple[Bus, Strategy]]:
        """Open the bus; end all participants at the end."""
        node = Node(self.network, self.orchestrator, is_center=True)
        try:
            yield node, _Launch(self, run)
        finally:
            node.close()
            if not self.orchestrator.is_dead:
                for participant in self.participants.values():
                    participant.process.kill()


class _Launch(Strategy):
    """The strategy of a simulated run."""

    def __init__(self, host: SimulatedHost, run: RunView) -> None:
        self._host = host
        self._run = run

    def launch(self, run: RunView) -> None:
        """Start all participants."""
        scenario = run.state.scenario
        names = self._host.start_order or [spec.name for spec in scenario.participants]
        for number, name in enumerate(names):
            spec = scenario.participant(name)
            options: dict[str, Any] = run.start_options(spec)
            options.pop("has_terminal", None)
            folder = options.pop("folder", scenario.folder)
            ticket = Ticket(
                run=self._run.key,
                name=spec.name,
                token=self._run.token,
                endpoint=Endpoint(listen=[], connect=["the simulation"]),
                join_timeout_s=spec.deadlines.join_s,
                protocols=SPOKEN,
                **options,
            )
            factory = import_participant(spec.participant, folder)
            participant = self._start(ticket, factory, 1001 + number)
            run.started(ParticipantState(spec, participant))

    def _start(self, ticket: Ticket, factory: Any, pid: int) -> SimulatedParticipant:
        host, name = self._host, ticket.name

        def work() -> int:
            node = Node(host.network, process, is_leaf=self._host.is_star)
            HOST.set(Host(ticket, node))
            try:
                code = main(host.wrap(name, factory))
            except Exception:  # noqa: BLE001  what a process does with one
                participant.errors += traceback.format_exc()
                code = 1
            if name in host.linger_ns:
                process.clock.sleep(host.linger_ns[name] / 1e9)
            return host.lies.get(name, code)

        process = Process(host.world, name, work)
        process.on_call = host.on_call[name]
        participant = SimulatedParticipant(process, pid, self._run.out / "logs" / f"{name}.log")
        host.participants[name] = participant
        process.start(host.start_ns.get(name, _START_NS))
        return participant
