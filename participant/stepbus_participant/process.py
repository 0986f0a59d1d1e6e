"""The process of a participant, or its thread in a run in one process."""

import importlib
import inspect
import re
import signal
import sys
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, ModuleType

from stepbus_schemas import Message, RunError, StepbusError, Types, WiringError, type_name

from .bus import Bus, BusError, ZenohBus
from .bus.ticket import Ticket, load_ticket
from .config import Config
from .files import read_file
from .hints import suggest
from .parameters.settings import Settings
from .participant import Participant, PortType
from .session import Session, Terminated, join

PARTICIPANTS = "stepbus.participants"
"""The entry points by which packages declare participants, as a scenario names them."""


def is_ours(module: str) -> bool:
    """Return whether a name is a module's of stepbus; no file of a scenario replaces one."""
    top = module.partition(".")[0]
    return top == "stepbus" or top.startswith("stepbus_")


def is_installed(module: str) -> bool:
    """Return whether a module is ours, or of a package that declares participants; likewise."""
    if is_ours(module):
        return True
    # It takes longer to load than all else here, and only some scenarios need it.
    from importlib.metadata import entry_points  # noqa: PLC0415

    top = module.partition(".")[0]
    return any(top == re.split("[.:]", p.value)[0] for p in entry_points(group=PARTICIPANTS))


def import_participant(name: str, folder: Path) -> type[Participant]:
    """Import the class `file.py:Class` or `module:Class`; return it.

    folder: that of the scenario. Raises WiringError where there is no such class, and whatever the
    module raises.
    """
    source, _, attribute = name.rpartition(":")
    module = import_source(source, folder)
    cls = getattr(module, attribute, None)
    if cls is None:
        raise WiringError(f"no class {attribute!r} in {source}{_alternatives(module, attribute)}")
    if not (isinstance(cls, type) and issubclass(cls, Participant)):
        raise WiringError(
            f"{attribute!r} in {source} is no participant; write "
            f"`class {attribute}(stepbus.Participant)`{_alternatives(module, attribute)}"
        )
    return cls


def import_source(source: str, folder: Path) -> ModuleType:
    """Import a module, or a file of a folder, in which `sys.path` has it search."""
    if not source.endswith(".py"):
        return importlib.import_module(source)
    path = (folder / source).absolute()
    name = _module_name(path)
    if name in sys.modules:
        return sys.modules[name]
    if str(path.parent) not in sys.path:
        # As for `python file.py`: beside it is what it imports.
        sys.path.insert(0, str(path.parent))
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = str(path)
    try:
        # As for `python file.py`, from no cache: that of a file changed in this second is old.
        exec(compile(read_file(path), path, "exec", dont_inherit=True), module.__dict__)  # noqa: S102
    except BaseException:
        sys.modules.pop(name, None)
        raise
    return module


def declared_parameters(source: str, folder: Path) -> type[Settings] | None:
    """Import what a scenario names; return its class `Params`, None where it declares none."""
    params = getattr(import_source(source, folder), "Params", None)
    return params if isinstance(params, type) and issubclass(params, Settings) else None


def _module_name(path: Path) -> str:
    """Return the name of a file's module: its own, unless another module has that."""
    loaded = sys.modules.get(path.stem)
    is_free = loaded is None or getattr(loaded, "__file__", None) == str(path)
    return path.stem if is_free else f"scenario.{path.stem}"


def _alternatives(module: ModuleType, name: str) -> str:
    classes = [
        other
        for other, value in inspect.getmembers(module, inspect.isclass)
        if issubclass(value, Participant) and value is not Participant and other != name
    ]
    return suggest(name, classes) if classes else ""


@dataclass(frozen=True)
class Host:
    """The place of one participant in a process that it shares with others.

    ticket: its identity. bus: what it takes instead of a connection to the ticket's endpoint. log:
    where it prints, and where a program that it starts has to. started: takes the process id, and
    group, of such a program, so that it can be ended.
    """

    ticket: Ticket
    bus: Bus
    log: Path | None = None
    started: Callable[[int], None] = lambda _pid: None


HOST: ContextVar[Host | None] = ContextVar("HOST", default=None)
"""Set by `stepbus run --in-process` where the program of a participant runs."""


Factory = Callable[[Config], Participant]


def main(factory: Factory) -> int:
    """Take part in the run of this process's ticket; return the exit code.

    factory: makes the participant from its configuration; usually its class. Exit code 0: the
    run ended; 1: this participant could not continue, its log says why; 2: there is no ticket.
    """
    hosted = HOST.get()
    try:
        host = hosted or _own_process()
    except WiringError as exc:
        return _report(str(exc), 2)
    except BusError as exc:
        return _report(str(exc), 1)
    try:
        try:
            if hosted is None:
                signal.signal(signal.SIGTERM, _terminate)
            take_part(factory, host.ticket, host.bus)
        finally:
            _take_no_more_signals()
    except (StepbusError, KeyboardInterrupt) as exc:
        return _report(f"{host.ticket.name}: {_own_error(exc) or type(exc).__name__}", 1)
    finally:
        # A process with an open session and a callback hangs at its exit (P2.6).
        host.bus.close()
    return 0


def _own_process() -> Host:
    """Return the bus of this process's ticket; raises WiringError without one, BusError."""
    ticket = load_ticket()
    try:
        return Host(ticket, ZenohBus(ticket.endpoint, ticket.run))
    except BusError as exc:
        raise BusError(f"{ticket.name}: {exc}") from exc


def take_part(factory: Factory, ticket: Ticket, bus: Bus) -> None:
    """Join a run over a bus, and step until it ends.

    Raises StepbusError when this participant cannot continue; the orchestrator knows why.
    """
    bus.declare_alive(f"alive/{ticket.name}")
    inputs, outputs = (_declared(factory, side) for side in ("inputs", "outputs"))
    types = Types.of(_classes(factory))
    welcome = join(bus, ticket, inputs, outputs, types)
    session = Session(
        factory,
        welcome,
        bus,
        types,
        faults=ticket.faults,
        profile=ticket.profile,
        checkpoint=ticket.checkpoint,
    )
    session.work()


def _declared(factory: Factory, side: str) -> dict[str, str] | None:
    """Return the ports that a participant's class requires, by type name; None: any."""
    ports: Mapping[str, PortType] | None = getattr(factory, side, None)
    if ports is None:
        return None
    return {
        port: type_name(item) if isinstance(item, type) else item for port, item in ports.items()
    }


def _classes(factory: Factory) -> list[type[Message]]:
    """Return the message classes that a participant's class requires."""
    sides = [getattr(factory, side, None) or {} for side in ("inputs", "outputs")]
    return [item for ports in sides for item in ports.values() if isinstance(item, type)]


def _terminate(_signal: int, _frame: FrameType | None) -> None:
    _take_no_more_signals()
    raise Terminated("ended by SIGTERM")


def _own_error(exc: BaseException) -> BaseException:
    """Return the error that a SIGTERM cut off on its way out of the participant, or `exc`."""
    cut_off = exc.__context__ if isinstance(exc, Terminated) else None
    while cut_off is not None and not isinstance(cut_off, RunError):
        cut_off = cut_off.__context__
    return cut_off or exc


def _take_no_more_signals() -> None:
    """From here on, a SIGTERM cuts off neither the closing nor the error that is being printed.

    The first SIGTERM calls it as well: a participant is interrupted once.
    """
    if signal.getsignal(signal.SIGTERM) is _terminate:
        signal.signal(signal.SIGTERM, _ignore)


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing; unlike SIG_IGN, programs that are started meanwhile do not inherit it."""


def _report(sentence: str, code: int) -> int:
    """Write one sentence to this process's log and return the exit code."""
    sys.stderr.write(sentence + "\n")
    return code
