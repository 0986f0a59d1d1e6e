"""How a command is declared, and the options that several commands have."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, dataclass_transform

from cyclopts import Group, Parameter, Token
from cyclopts.validators import Number, mutually_exclusive

GROUPS = ("run", "look", "test", "attach", "many", "more")
"""Groups of commands in the overview; a command of another package may name one too."""


@dataclass_transform(frozen_default=True)
class Command:
    """A command, declared by a class: its docstring is its help, its fields are its options.

    The docstring begins with the line of the overview; its lines that begin with `$` are examples.
    Fields before `KW_ONLY` are positional. The docstring below a field is its help.

    work: module beside its own, whose `<name>_command` gets an instance, and returns an exit code
    or an `Answer`. Help does not load it. group: where it stands in the overview. is_run: runs a
    scenario, and ends in time though no reader takes what it prints.
    """

    work: ClassVar[str]
    group: ClassVar[str] = "more"
    is_run: ClassVar[bool] = False

    def __init_subclass__(cls, **given: Any) -> None:
        """Take what the class statement says beside its bases."""
        for name, value in given.items():
            setattr(cls, name, value)

    @classmethod
    def word(cls) -> str:
        """Return its name on the command line: `export-fmu` of a class `ExportFmu`."""
        return re.sub("(?<=[a-z])(?=[A-Z])", "-", cls.__name__).lower()

    def load(self) -> Callable[[Any], Any]:
        """Return the function that does it; raises ImportError or AttributeError."""
        package = type(self).__module__.rpartition(".")[0]
        module = import_module(".".join(filter(None, (package, self.work))))
        function: Callable[[Any], Any] = getattr(module, f"{type(self).__name__.lower()}_command")
        return function

    @classmethod
    def complete(cls) -> "type[Command]":
        """Return the class as a dataclass; others may add options that are installed."""
        # For all commands, it would take 20 ms of each start.
        return dataclass(eq=False, repr=False)(cls)


def scenarios(context: Any) -> list[str]:
    """Return the scenarios that a word may become, as a shell completes it."""
    builtin = import_module("stepbus_orchestrator.scenario.locate").builtin_names()
    typed = Path(context.incomplete)
    folder = typed if context.incomplete.endswith("/") else typed.parent
    paths = folder.iterdir() if folder.is_dir() else ()
    names = [f"{path}/" if path.is_dir() else str(path) for path in paths]
    return [*builtin, *(name for name in names if name.endswith(("/", ".yaml")))]


def _settings(_type: object, tokens: Sequence[Token]) -> tuple[str, ...]:
    override = import_module("stepbus_orchestrator.scenario.override")
    return tuple(override.named_from_here(token.value) for token in tokens)


def _duration(_type: object, tokens: Sequence[Token]) -> str:
    import_module("stepbus_participant").parse_duration(tokens[0].value)
    return tokens[0].value


FLAT = Parameter(name="*")
"""The fields of a dataclass are options of their own."""
EITHER = Parameter(group=Group("options", validator=mutually_exclusive))
"""At most one of these may be given."""
Texts = tuple[str, ...]
Names = Annotated[Texts, Parameter(metavar="PARTICIPANT")]
Faults = Annotated[Texts, Parameter(name="--fault", metavar="FAULT")]
Settings = Annotated[Texts, Parameter(metavar="PATH=VALUE", converter=_settings)]
Set = Annotated[
    Settings,
    Parameter(
        help="override one value, e.g. controller.params.kp=80 or duration=2s; may be repeated"
    ),
]
Scenario = Annotated[
    str,
    Parameter(
        completer=scenarios,
        help="a scenario file, a folder with a scenario.yaml, or a built-in scenario such as "
        "two_link or two_link/pd",
    ),
]
Recording = Annotated[Path, Parameter(help="a run.mcap, or the folder of its run")]
Folder = Annotated[Path | None, Parameter(metavar="FOLDER")]
File = Annotated[Path | None, Parameter(metavar="FILE")]
Duration = Annotated[str, Parameter(metavar="DURATION", converter=_duration)]
NewRun = Annotated[Folder, Parameter(help="folder of the new run (default: in runs/)")]
Json = Annotated[bool, Parameter(help="print the result as JSON only")]
Trust = Annotated[
    bool,
    Parameter(
        help="start the recorded programs, even if they are not those in your scenario's folder"
    ),
]
NoReport = Annotated[bool, Parameter(help="do not write report.html and report.png")]
BridgeFormat = Annotated[
    Literal["json", "msgpack", "raw"] | None,
    Parameter(help="start the program through `stepbus bridge`"),
]
Port = Annotated[int, Parameter(validator=Number(gte=0, lte=65535))]
Count = Annotated[int, Parameter(validator=Number(gte=1))]
"""1 or more."""
Index = Annotated[int, Parameter(validator=Number(gte=0))]
"""0 or more."""
