"""What a recording would start here, and whether anybody has to be asked first."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.known_programs import fingerprint, is_known
from stepbus_orchestrator.recording.layout import SCENARIO_ATTACHMENT
from stepbus_orchestrator.replay.rerun import attached
from stepbus_orchestrator.scenario import ParticipantSpec, upgraded, written_program
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

from .work_tree import WorkTree

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

    fingerprint: of all that it can start. commands: participant → its command line. files: from
    the recording, which a program may execute. is_known: whether you have run them here.
    """

    fingerprint: str
    commands: dict[str, tuple[str, ...]]
    files: Sequence[str]
    is_known: bool

    @property
    def is_harmless(self) -> bool:
        """Return whether nothing of it is executed, or you have run all of it here."""
        return self.is_known or not (self.commands or self.files)

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
    program of the user's. tree: it is started from there: of the recording, nothing is executed,
    and what is started is known when you have run a scenario of that folder here; with overrides of
    the run (from a file beside the recording) only when you have made the recording too.

    Raises RecordingFailed or WiringError when the recording holds no scenario, or a file whose
    name leads out of its folder.
    """
    scenario, files = attached(recording)
    programs = fingerprint(scenario, files)
    if tree is not None and participant is not None:
        recorded_commands(recording)
        program = tree.program(participant)
        return Programs(
            fingerprint=programs,
            commands={participant: program.exec or (program.participant,)},
            files=(f"those in {tree.folder}",),
            is_known=tree.is_known and (not tree.overrides or is_known(programs)),
        )
    commands = {
        name: words
        for name, words in recorded_commands(recording).items()
        if participant in {None, name} and not own_program
    }
    code = [name for name in files if PurePosixPath(name).suffix.lower() not in _DATA]
    return Programs(
        fingerprint=programs,
        commands=commands,
        files=code if commands or own_program else [],
        is_known=is_known(programs),
    )


def recorded_commands(recording: Recording) -> dict[str, tuple[str, ...]]:
    """Return the command, or the class, of each participant; raises WiringError without one."""
    found = recorded_programs(recording).items()
    return {name: spec.exec or (spec.participant,) for name, spec in found}


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
