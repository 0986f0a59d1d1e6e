"""What a recording would start here, and whether you are asked: not for your work tree."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.layout import SCENARIO_ATTACHMENT
from stepbus_orchestrator.replay.rerun import attached, fingerprint
from stepbus_orchestrator.replay.work_tree import WorkTree, find_work_tree
from stepbus_orchestrator.scenario import ParticipantSpec, upgraded, written_program
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

_DATA = frozenset(
    (
        *(".csv", ".dae", ".jpg", ".json", ".md", ".mtl", ".obj", ".png", ".srdf", ".stl", ".txt"),
        *(".urdf", ".xml", ".yaml", ".yml"),
    )
)
"""Files that no program of ours executes; a `.xacro` has expressions."""


@dataclass(frozen=True, kw_only=True)
class Programs:
    """What a recording would start, with your rights.

    fingerprint: of all that it can start. commands: participant → its command line, or its class
    where that is in a file of the recording: installed ones are yours. files: from the recording,
    which a program may execute. is_yours: whether all of it stands in your work tree like this.
    """

    fingerprint: str
    commands: dict[str, tuple[str, ...]]
    files: Sequence[str]
    is_yours: bool

    @property
    def is_harmless(self) -> bool:
        """Return whether it may start unasked."""
        return self.is_yours or not (self.commands or self.files)

    def lines(self) -> list[str]:
        """Return what would be started, one line each; no character of it controls a terminal."""
        width = max(map(len, self.commands), default=0)
        commands = (f"{name:{width}}  {shlex.join(c)}" for name, c in self.commands.items())
        files = [f"its files: {', '.join(self.files)}"] if self.files else []
        return [_harmless(line) for line in (*commands, *files)]


def programs_of(
    recording: Recording,
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
    scenario, files = attached(recording)
    specs = recorded_programs(recording)
    code = {name: files[name] for name in files if PurePosixPath(name).suffix.lower() not in _DATA}
    started = [name for name in specs if participant in {None, name} and not own_program]
    if tree is not None and participant is not None:
        program = tree.program(participant)
        return Programs(
            fingerprint=fingerprint(scenario, files),
            commands={participant: program.exec or (program.participant,)},
            files=(f"those in {tree.folder}",),
            is_yours=tree.is_yours,
        )
    commands = {
        name: specs[name].exec or (specs[name].participant,)
        for name in started
        if specs[name].exec or _is_attached(specs[name].participant, code)
    }
    is_executed = bool(commands) or own_program
    return Programs(
        fingerprint=fingerprint(scenario, files),
        commands=commands,
        files=list(code) if is_executed else [],
        is_yours=is_executed and _stands_in_a_work_tree(recording, specs, code),
    )


def _is_attached(named: str, code: Mapping[str, bytes]) -> bool:
    """Return whether a class is in a file of the recording, and no installed one."""
    source = named.rpartition(":")[0]
    top = source.partition(".")[0]
    return source.endswith(".py") or any(
        name == f"{top}.py" or name.startswith(f"{top}/") for name in code
    )


def _stands_in_a_work_tree(
    recording: Recording, specs: Mapping[str, ParticipantSpec], code: Mapping[str, bytes]
) -> bool:
    try:
        tree = find_work_tree(recording, next(iter(specs), ""))
    except WiringError:
        return False
    return tree is not None and _is_in(tree, specs, code)


def _is_in(tree: WorkTree, specs: Mapping[str, ParticipantSpec], code: Mapping[str, bytes]) -> bool:
    """Return whether a work tree of yours has the same programs, and the same files of code."""
    rows = tree.participants()
    return (
        tree.is_yours
        and rows.keys() == specs.keys()
        and all(tree.program(name) == spec for name, spec in specs.items())
        and all(tree.has(name, content) for name, content in code.items())
    )


def recorded_programs(recording: Recording) -> dict[str, ParticipantSpec]:
    """Return the class or program of each participant, as it is recorded; raises WiringError."""
    text = recording.attachments[SCENARIO_ATTACHMENT].decode(errors="replace")
    content = parse_yaml(SCENARIO_ATTACHMENT, text)
    try:
        rows = upgraded(content)["participants"].items()
        return {name: written_program(name, row) for name, row in rows}
    except (KeyError, TypeError, AttributeError) as exc:
        raise WiringError(f"{recording.path}: its {SCENARIO_ATTACHMENT} is no scenario") from exc


def _harmless(text: str) -> str:
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
