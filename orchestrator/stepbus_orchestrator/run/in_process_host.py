"""The host of a run whose participants are all in this process, over a bus in memory."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.scenario import Scenario
from stepbus_participant import Bus

from .host import Opening, Strategy

# A run in processes of their own is quicker to start without what is imported below.


@dataclass(frozen=True, kw_only=True)
class InProcess:
    """Has all participants in this process.

    start_order: as of `Processes`. owns_descriptors: descriptors 1 and 2 are nobody else's, and
    what libraries in C print goes to a log.
    """

    start_order: Sequence[str] | None = None
    owns_descriptors: bool = False

    def check(self, scenario: Scenario) -> None:
        """Raise WiringError for a scenario that cannot run in one process, with every reason."""
        from .inprocess import check_scenario  # noqa: PLC0415

        check_scenario(scenario)

    @contextlib.contextmanager
    def open(self, opening: Opening) -> Iterator[tuple[Bus, Strategy]]:
        """Put the process in order for participants, and back at the end."""
        from .inprocess import NATIVE_LOG, LocalRun, ScenarioModules, Surroundings  # noqa: PLC0415

        folder = opening.scenario.folder
        sources = (spec.participant.rpartition(":")[0] for spec in opening.scenario.participants)
        modules = ScenarioModules(folder, [name for name in sources if name.endswith(".py")])
        local = LocalRun(opening, modules, self.start_order)
        native_log = opening.logs / NATIVE_LOG if self.owns_descriptors else None
        with contextlib.ExitStack() as stack:
            try:
                around = Surroundings(folder, modules, local.guard, native_log)
                stack.enter_context(around)
            except OSError as exc:
                raise StartFailed(
                    f"before the first step: {exc.filename}: {exc.strerror}; a run in one process "
                    "works in the scenario's folder, and logs to the run's"
                ) from exc
            stack.enter_context(local.watched(around))
            yield local.bus, local
