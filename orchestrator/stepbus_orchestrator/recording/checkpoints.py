"""The checkpoints of a run: files beside its recording, which they are no part of.

`checkpoints/<participant>.<step>` is a state, byte for byte as the participant has sent it.
`checkpoints/index.json` is written when the run has ended; it has the SHA-256 of each state, and
that of the recording, which no other recording can have.
"""

import contextlib
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import layout
from stepbus_participant import make_new_folder, read_file, write_file
from stepbus_schemas import UNDECODABLE, explained


class _Index(msgspec.Struct):
    """recording: SHA-256 of run.mcap. states: participant → step → SHA-256."""

    recording: str
    states: dict[str, dict[int, str]]


@dataclass(frozen=True, kw_only=True)
class SavedState:
    """A state of a participant. step: the one that it does next. path: of the file."""

    step: int
    path: Path


class CheckpointWriter:
    """Writes the checkpoints of a run into its folder."""

    def __init__(self, out: Path) -> None:
        self._folder = out / layout.CHECKPOINTS_FOLDER
        self._states: dict[str, dict[int, str]] = {}
        self._is_made = False

    def add(self, name: str, step: int, state: bytes) -> None:
        """Write the state of a participant; raises RecordingFailed."""
        self._write(_file_name(name, step), state)
        self._states.setdefault(name, {})[step] = hashlib.sha256(state).hexdigest()

    def finish(self, sha256: str) -> None:
        """Write the index; sha256: of the recording, which has ended. Raises RecordingFailed."""
        if self._states:
            index = _Index(recording=sha256, states=self._states)
            self._write(layout.CHECKPOINTS_INDEX, msgspec.json.encode(index))

    def _write(self, name: str, data: bytes) -> None:
        try:
            if not self._is_made:
                make_new_folder(self._folder)
                self._is_made = True
            write_file(self._folder / name, data)
        except OSError as exc:
            raise RecordingFailed(f"{self._folder / name}: {exc.strerror}") from exc


class Checkpoints:
    """The checkpoints of a recording, where its folder has any.

    problems: a sentence for each that cannot be used; grows as they are read.
    """

    def __init__(self, recording: Path, sha256: str) -> None:
        self._folder = recording.parent / layout.CHECKPOINTS_FOLDER
        self.problems: list[str] = []
        self._states: dict[str, dict[int, str]] = {}
        path = self._folder / layout.CHECKPOINTS_INDEX
        if not self._folder.is_dir():
            return
        try:
            index = msgspec.json.decode(read_file(path), type=_Index)
        except (OSError, *UNDECODABLE) as exc:
            self.problems.append(f"no checkpoints: {path}: {explained(exc)}")
            return
        if index.recording == sha256:
            self._states = index.states
        else:
            self.problems.append(f"no checkpoints: those in {path.parent} are of another recording")

    def below(self, name: str, step: int) -> Iterator[SavedState]:
        """Yield the checkpoints of a participant before steps below `step`, newest first.

        One that is damaged is left out, and becomes a problem.
        """
        states = self._states.get(name, {})
        for saved_step in sorted(states, reverse=True):
            if 0 < saved_step < step:
                path = (self._folder / _file_name(name, saved_step)).absolute()
                with contextlib.suppress(OSError):
                    if hashlib.sha256(read_file(path)).hexdigest() == states[saved_step]:
                        yield SavedState(step=saved_step, path=path)
                        continue
                self.problems.append(f"checkpoint {path} is damaged; an earlier state is used")


def _file_name(name: str, step: int) -> str:
    return f"{name}.{step}"
