"""How to run a scenario, as opposed to what."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.run.extension import RunExtension


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to run, as opposed to what.

    out: folder of the run's files; made, must be empty. start_order: names of the participants
    in the order they are started; default: that of the scenario. around: is entered before the
    first participant is started and left after the last has ended; it gets their processes by
    name. in_process: host all participants in this process, over a bus in memory.
    owns_descriptors: then descriptors 1 and 2 are nobody else's, and what libraries in C print goes
    to a log. is_recorded: whether the run writes run.mcap, timing.mcap and result.json.
    extensions: features of the run, beside those that every run has.
    """

    out: Path
    start_order: Sequence[str] | None = None
    around: Callable[[Mapping[str, Child]], AbstractContextManager[object]] = nullcontext
    in_process: bool = False
    owns_descriptors: bool = False
    is_recorded: bool = True
    extensions: Sequence[RunExtension] = ()
