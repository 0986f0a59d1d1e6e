"""The hosts that ship: a process for each participant, or all of them in this one."""

import contextlib
import dataclasses
import os
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from types import MappingProxyType
from typing import Any, ClassVar

from stepbus_orchestrator.processes.endpoints import Mesh, make_mesh
from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.processes.slots import RunSlots, make_slots
from stepbus_orchestrator.processes.warm import all_started, warm_parent
from stepbus_orchestrator.run.bus import open_bus
from stepbus_orchestrator.run.extension import RunView, Strategy
from stepbus_orchestrator.run.folder import LOGS_FOLDER
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.run.live_file import Live, forget
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.program import command
from stepbus_participant import Bus, Clock, Disk
from stepbus_schemas import WiringError


class Elsewhere:
    """Reaches the participants on other hosts; this one reaches none.

    behind: as of `make_mesh`; empty: all participants are here. relay: process of the gateway.
    """

    relay = 0

    behind: Mapping[str, Collection[str]] = MappingProxyType({})

    def check(self, scenario: Scenario) -> None:
        """Raise WiringError for a scenario that cannot run so, with every reason."""
        named = [f"{one.name} ({one.host})" for one in scenario.participants if one.host]
        if named:
            raise WiringError(
                f"{', '.join(named)}: to run on another host; say with --hosts FILE where that is, "
                "or have it here with `--set NAME.host=`"
            )

    def opened(self, run: RunView, launcher: Launcher, mesh: Mesh) -> AbstractContextManager[None]:
        """Reach the other hosts, and leave them at the end with nothing of the run.

        Raises StartFailed where one cannot be reached.
        """
        return contextlib.nullcontext()

    def start(self, spec: ParticipantSpec, options: dict[str, Any]) -> ParticipantState:
        """Start a participant on its host, or let the user; raises StartFailed."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True, kw_only=True)
class Processes:
    """Starts a process for each participant, and links them over Zenoh.

    start_order: names of the participants that are started, in this order; default: all, as in the
    scenario. is_star: they are linked to the orchestrator only, which passes on what they publish.
    elsewhere: reaches those on other hosts.
    """

    clock: ClassVar[Clock] = time
    disk: ClassVar[Disk] = os
    start_order: Sequence[str] | None = None
    is_star: bool = False
    elsewhere: Elsewhere = dataclasses.field(default_factory=Elsewhere)

    def check(self, scenario: Scenario) -> None:
        """Raise WiringError for a scenario that needs other hosts than those that are given."""
        self.elsewhere.check(scenario)

    @contextlib.contextmanager
    def open(self, run: RunView) -> Iterator[tuple[Bus, Strategy]]:
        """Open the bus of a run; at the end, say what its processes have left behind."""
        launcher = Launcher(run=run.key, token=run.token, logs=run.out / LOGS_FOLDER)
        held = contextlib.ExitStack()
        try:
            scenario = run.state.scenario
            order = self.start_order or [spec.name for spec in scenario.participants]
            specs = [one for one in scenario.participants if one.name in order]
            started = dataclasses.replace(scenario, participants=tuple(specs))
            distant = self.elsewhere
            mesh = make_mesh(
                started,
                launcher.folder,
                run.key,
                held,
                is_star=self.is_star,
                behind=distant.behind,
            )
            slots = RunSlots()
            # The orchestrator passes on what it plays.
            if not self.is_star:
                slots = make_slots(scenario, launcher)
            with (
                warm_parent(sum(bool(one.participant) for one in specs)),
                contextlib.ExitStack() as stack,
            ):
                bus = open_bus(mesh.orchestrator, run.key)
                stack.callback(bus.close)
                Live(run=run.key, token=run.token, endpoint=mesh.caller).save(run.out)
                stack.callback(forget, run.out)
                stack.callback(slots.close)
                stack.enter_context(distant.opened(run, launcher, mesh))
                yield bus, _Launch(launcher, mesh, slots, order, distant)
        finally:
            held.close()
            for name, text in launcher.end_all():
                run.warn(name, text)


class _Launch(Strategy):
    """The strategy of a run in processes."""

    has_links = True

    def __init__(
        self,
        launcher: Launcher,
        mesh: Mesh,
        slots: RunSlots,
        start_order: Sequence[str],
        elsewhere: Elsewhere,
    ) -> None:
        self._mesh = mesh
        self.slots = slots
        self._launcher = launcher
        self._start_order = start_order
        self._elsewhere = elsewhere
        self.relay = elsewhere.relay

    def launch(self, run: RunView) -> None:
        """Start the participants in their order; let the user start those that are external."""
        for name in self._start_order:
            run.started(self._start(run.state.scenario.participant(name), run))
        all_started()

    def _start(self, spec: ParticipantSpec, run: RunView) -> ParticipantState:
        options = run.start_options(spec)
        if spec.name not in self._mesh.participants:
            return self._elsewhere.start(spec, options)
        options |= {"slots": self.slots.folder}
        folder = options.pop("folder", run.state.scenario.folder)
        endpoint = self._mesh.participants[spec.name]
        if spec.is_external:
            external = self._launcher.admit(spec, endpoint, folder, **options)
            run.timing.event("external", spec.name)
            return ParticipantState(spec, external, external=external)
        argv = command(spec.program, folder)
        child = self._launcher.start(spec, argv, endpoint, folder, **options)
        run.timing.event("spawn", spec.name, f"pid {child.pid}")
        return ParticipantState(spec, child)


# A run in processes of their own is quicker to start without what is imported below.


@dataclasses.dataclass(frozen=True, kw_only=True)
class InProcess:
    """Has all participants in this process.

    owns_descriptors: descriptors 1 and 2 are the run's alone, and what libraries in C print goes to
    a log. is_star: as of `Processes`. instead: what the user can do where it is refused. memory:
    of `watched_memory`, which many runs share; default: each run has its own.
    """

    clock: ClassVar[Clock] = time
    disk: ClassVar[Disk] = os
    owns_descriptors: bool = False
    is_star: bool = False
    instead: str = "omit --in-process"
    memory: Any = None

    def check(self, scenario: Scenario) -> None:
        """Raise WiringError for a scenario that cannot run in one process, with every reason."""
        from stepbus_orchestrator.run.inprocess.local_run import check_scenario  # noqa: PLC0415

        check_scenario(scenario, self.instead)

    @contextlib.contextmanager
    def open(self, run: RunView) -> Iterator[tuple[Bus, Strategy]]:
        """Put the process in order for participants, and back at the end."""
        from stepbus_orchestrator.run.inprocess.local_run import LocalRun  # noqa: PLC0415

        local = LocalRun(run, self.clock, is_star=self.is_star, memory=self.memory)
        with local.opened(owns_descriptors=self.owns_descriptors):
            yield local.bus, local
