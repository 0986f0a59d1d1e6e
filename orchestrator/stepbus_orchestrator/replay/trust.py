"""What a recording would start here, and whether you are asked: not for your work tree."""

import os
import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from stepbus_orchestrator.recording.layout import SCENARIO_ATTACHMENT
from stepbus_orchestrator.replay.sources import Recorded, Sources
from stepbus_orchestrator.replay.work_tree import WorkTree, find_work_tree, is_yours
from stepbus_orchestrator.scenario.locate import scenario_folders
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.program import participant_classes, programs_in
from stepbus_orchestrator.scenario.scenario_files import is_file
from stepbus_participant import is_installed, read_file
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

_DATA = (
    *(".csv", ".dae", ".jpg", ".json", ".md", ".mtl", ".obj", ".png", ".srdf", ".stl", ".txt"),
    *(".urdf", ".xml", ".yaml", ".yml"),
)
"""Files that no program of ours executes; a `.xacro` has expressions."""


@dataclass(frozen=True, kw_only=True)
class Programs:
    """What a recording would start, with your rights.

    fingerprint: of all that it can start. commands: participant → its command line or class, and
    the classes that its parameters name; not those that installed packages declare: these are
    yours. files: from the recording, which a program may execute. is_yours: whether all of it
    stands in your work tree like this, or is declared. edited: files of your work tree that differ
    from those of the recording.
    """

    fingerprint: str
    commands: Mapping[str, Sequence[str]]
    files: Sequence[str]
    is_yours: bool
    edited: Sequence[str] = ()

    def lines(self) -> list[str]:
        """Return what would be started, one line each; no character of it controls a terminal."""
        width = max(map(len, self.commands), default=0)
        commands = (f"{name:{width}}  {shlex.join(c)}" for name, c in self.commands.items())
        files = [f"its files: {', '.join(self.files)}"] if self.files else []
        return [_harmless(line) for line in (*commands, *files, *self.notes())]

    def notes(self) -> list[str]:
        """Return a sentence for each file that you have edited since."""
        return [f"{name} differs from the recording, whose own copy runs" for name in self.edited]


def programs_of(
    recording: Recorded,
    participant: str | None = None,
    *,
    own_program: bool = False,
    tree: WorkTree | None = None,
) -> Programs:
    """Return what a recording would start.

    participant: the only one that is started; default: all. own_program: it is started with a
    program of the user's. tree: it is started from there: of the recording, nothing is executed.

    Raises RecordingFailed or WiringError when the recording holds no scenario, or a file whose
    name leads out of its folder.
    """
    sources = Sources.of(recording.path, recording.attachments)
    files = sources.files
    specs = recorded_programs(recording)
    code = {name: files[name] for name in files if PurePosixPath(name).suffix.lower() not in _DATA}
    edited: Sequence[str] = ()
    modules = {PurePosixPath(name).parts[0].removesuffix(".py") for name in code}
    plugins = {n: _plugins(recording, n, modules) for n in specs if participant in {None, n}}
    named = {name: classes for name, classes in plugins.items() if classes}
    if tree is not None and participant is not None:
        # The tree has its own parameters.
        named = {}
        commands = {participant: _command(tree.programs[participant])}
        shown, is_own = [f"those in {tree.folder}"], tree.is_yours
    else:
        started = [] if own_program else plugins
        commands = {n: _command(specs[n]) for n in started if _is_recorded(specs[n], modules)}
        # An installed participant may execute a file too: the law of a controller is a class.
        own = {name: content for name, content in files.items() if not _is_shipped(name, content)}
        others = {name: own[name] for name in code if name in own}
        home = _work_tree(recording, specs) if commands or own else None
        shown = list(code)
        is_own = not (commands or others) or (
            home is not None and _stands_in(home, specs if commands else {}, others)
        )
        if home is not None:
            there = {name: home.folder / name for name in own if is_file(home.folder / name)}
            edited = [os.path.relpath(f) for name, f in there.items() if not _has(f, own[name])]
    commands |= {name: (*_command(specs[name]), *classes) for name, classes in named.items()}
    return Programs(
        fingerprint=sources.fingerprint,
        commands=commands,
        files=shown,
        is_yours=is_own and not named,
        edited=edited,
    )


def _command(spec: ParticipantSpec) -> Sequence[str]:
    return spec.exec or (spec.participant,)


def _is_recorded(spec: ParticipantSpec, modules: Collection[str]) -> bool:
    """Return whether a program is one of the recording, and no class that a package declares."""
    if spec.exec or not spec.participant:
        return bool(spec.exec)
    top = spec.participant.partition(":")[0].partition(".")[0]
    return spec.participant not in participant_classes() or top in modules


def _plugins(recording: Recorded, participant: str, modules: Collection[str]) -> list[str]:
    """Return the classes that parameters name, such as `law`, of modules installed for other uses.

    A class in a file of the recording counts as that file.
    """
    row = recording.scenario["participants"][participant]
    params = row.get("params") if isinstance(row, dict) else None
    return [text for text in _texts_in(params) if _is_foreign_class(text, modules)]


def _texts_in(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _texts_in(item)


def _is_foreign_class(text: str, modules: Collection[str]) -> bool:
    module, _, attribute = text.partition(":")
    is_class = attribute.isidentifier() and all(map(str.isidentifier, module.split(".")))
    return is_class and module.partition(".")[0] not in modules and not is_installed(module)


def _is_shipped(name: str, content: bytes) -> bool:
    """Return whether a file is that of an installed scenario."""
    scenarios = (
        scenario for folder in scenario_folders().values() for scenario in folder.iterdir()
    )
    return any(_has(scenario / name, content) for scenario in scenarios)


def _work_tree(recording: Recorded, specs: Mapping[str, ParticipantSpec]) -> WorkTree | None:
    """Return the scenario of a recording in the work tree; None where there is none, or several."""
    try:
        return find_work_tree(recording, next(iter(specs), ""))
    except WiringError:
        return None


def _stands_in(
    tree: WorkTree, specs: Mapping[str, ParticipantSpec], code: Mapping[str, bytes]
) -> bool:
    """Return whether a work tree of yours has the same programs, and the same files of code."""
    return (
        tree.is_yours
        and tree.programs == {**tree.programs, **specs}
        and all(is_yours(tree.folder / n) and _has(tree.folder / n, c) for n, c in code.items())
    )


def _has(path: Path, content: bytes) -> bool:
    try:
        return read_file(path) == content
    except OSError:
        return False


def recorded_programs(recording: Recorded) -> dict[str, ParticipantSpec]:
    """Return the class or program of each participant, as it is recorded; raises WiringError."""
    text = recording.attachments[SCENARIO_ATTACHMENT].decode(errors="replace")
    try:
        return programs_in(parse_yaml(SCENARIO_ATTACHMENT, text))
    except (KeyError, TypeError, AttributeError) as exc:
        raise WiringError(f"{recording.path}: its {SCENARIO_ATTACHMENT} is not a scenario") from exc


def _harmless(text: str) -> str:
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
