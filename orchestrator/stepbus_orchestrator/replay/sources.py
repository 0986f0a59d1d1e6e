"""What a recording can be run again from: its scenario, and the files of that."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Protocol

from stepbus_orchestrator.errors import OutputExists, RecordingFailed
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.recording.layout import SCENARIO_ATTACHMENT
from stepbus_orchestrator.run.result import own_versions
from stepbus_participant import make_folder, make_new_folder, write_file
from stepbus_participant.parameters import is_file_name

SOURCE_FOLDER = "source"
_PROGRAMS = (b"#!", b"\x7fELF")
_LEVEL = "scenario_folder"


class Recorded(Protocol):
    """What a run can be repeated from: a recording, or a run of a sweep."""

    @property
    def path(self) -> Path:
        """Return the file that stands for it."""

    @property
    def attachments(self) -> Mapping[str, bytes]:
        """Return name → content; the scenario and its files are among them."""

    @property
    def scenario(self) -> Mapping[str, Any]:
        """Return the scenario, as plain data."""


@dataclass(frozen=True)
class Sources:
    """A scenario and its files, by name."""

    scenario: bytes
    files: Mapping[str, bytes]

    @classmethod
    def of(cls, recording: Recorded) -> "Sources":
        """Return those of a recording.

        Raises RecordingFailed when it holds no scenario, a file whose name leads out of its folder,
        or a scenario that takes programs or message types from elsewhere: no run records these.
        """
        path, scenario = recording.path, recording.attachments.get(SCENARIO_ATTACHMENT)
        if scenario is None:
            raise RecordingFailed(
                f"{path} contains no {SCENARIO_ATTACHMENT}: is it the run.mcap of a run?"
            )
        files = layout.files_of(recording.attachments)
        for name in files:
            file = PurePosixPath(name)
            below = file.parts[_levels(name) :]
            if file.is_absolute() or ".." in below or not below or "\0" in name:
                raise RecordingFailed(f"{path}: attached file {name!r} points outside its folder")
        if "extends" in recording.scenario:
            raise RecordingFailed(f"{path}: its scenario has the key 'extends': refused")
        types = recording.scenario.get("types")
        for source in types if isinstance(types, list) else [types]:
            if isinstance(source, str) and not is_file_name(source):
                raise RecordingFailed(
                    f"{path}: its message types refer to the module {source!r}: refused"
                )
        return cls(scenario, files)

    def unpack(self, folder: Path) -> Path:
        """Write them to a new folder and return the scenario's path.

        Where files are in folders above the scenario's (`../models/arm.urdf`), the scenario is as
        many levels below the new folder. Raises RecordingFailed when they cannot be written.
        """
        home = folder.joinpath(*[_LEVEL] * max(map(_levels, self.files), default=0))
        try:
            make_new_folder(folder)
            make_folder(home)
            for name, content in self.files.items():
                file = Path(os.path.normpath(home / name))
                make_folder(file.parent)
                write_file(file, content, 0o755 if content.startswith(_PROGRAMS) else 0o644)
            write_file(home / SCENARIO_ATTACHMENT, self.scenario)
        except OSError as exc:
            raise RecordingFailed(
                f"{exc.filename or folder} cannot be written: {exc.strerror}; choose another --out"
            ) from exc
        return home / SCENARIO_ATTACHMENT


def _levels(name: str) -> int:
    """Return how many folders above the scenario's a file is."""
    parts = PurePosixPath(name).parts
    return next((n for n, part in enumerate(parts) if part != ".."), len(parts))


def unpack_into(out: Path, sources: Sources) -> Path:
    """Write sources into the folder of a new run; raises OutputExists where it holds one."""
    if (out / "logs").exists() or (out / SOURCE_FOLDER).exists():
        raise OutputExists(f"{out} already contains a run; choose another --out")
    return sources.unpack(out / SOURCE_FOLDER)


def version_notes(who: str, recorded: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Return a sentence for each thing that is another than it was."""
    return [
        (
            f"{who} ran with {name} {recorded.get(name, 'absent')}, here it is "
            f"{now.get(name, 'absent')}"
        )
        for name in sorted({*recorded, *now})
        if recorded.get(name) != now.get(name)
    ]


def own_version_notes(recording: Recording) -> list[str]:
    """Return a sentence for each thing that the orchestrator ran on and does no more."""
    ran_on = layout.versions_of(recording.metadata).get(layout.ORCHESTRATOR, {})
    return version_notes("the orchestrator", ran_on, own_versions())
