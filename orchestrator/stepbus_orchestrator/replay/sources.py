"""What a recording can be run again from: its scenario, and the files of that."""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Protocol

from stepbus_orchestrator.errors import OutputExists, RecordingFailed, argument
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.recording.layout import SCENARIO_ATTACHMENT
from stepbus_orchestrator.run.result import own_versions
from stepbus_participant import SettingsError, make_folder, make_new_folder, write_file
from stepbus_participant.parameters import is_file_name, parse_yaml

SOURCE_FOLDER = "source"
_PROGRAMS = (b"#!", b"\x7fELF")
_LEVEL = "scenario_folder"


class Recorded(Protocol):
    """What a run can be repeated from: a recording, or a run of a sweep."""

    @property
    def path(self) -> Path:
        """Return the file that stands for it."""
        ...

    @property
    def attachments(self) -> Mapping[str, bytes]:
        """Return name → content; the scenario and its files are among them."""
        ...

    @property
    def scenario(self) -> Mapping[str, Any]:
        """Return the scenario, as plain data."""
        ...


@dataclass(frozen=True)
class Sources:
    """A scenario and its files, by name."""

    scenario: bytes
    files: Mapping[str, bytes]

    @classmethod
    def of(cls, recording: Path, attachments: Mapping[str, bytes]) -> "Sources":
        """Return those among the attachments of a recording.

        Raises RecordingFailed when it holds no scenario, or a file whose name leads out of its
        folder.
        """
        if SCENARIO_ATTACHMENT not in attachments:
            raise RecordingFailed(
                f"{recording} contains no {SCENARIO_ATTACHMENT}: is it the run.mcap of a run?"
            )
        files = layout.files_of(attachments)
        for name in files:
            path = PurePosixPath(name)
            below = path.parts[_levels(name) :]
            if path.is_absolute() or ".." in below or not below or "\0" in name:
                raise RecordingFailed(
                    f"{recording}: attached file {name!r} points outside its folder"
                )
        _refuse_unresolved(recording, attachments[SCENARIO_ATTACHMENT])
        return cls(attachments[SCENARIO_ATTACHMENT], files)

    @property
    def fingerprint(self) -> str:
        """Return the SHA-256 of all that a recording can start."""
        digest = hashlib.sha256()
        for name, content in [("", self.scenario), *sorted(self.files.items())]:
            for part in (name.encode(errors="surrogateescape"), content):
                digest.update(len(part).to_bytes(8, "little"))
                digest.update(part)
        return digest.hexdigest()

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
                f"{exc.filename or folder} cannot be written: {exc.strerror}; "
                f"choose another {argument('--out')}"
            ) from exc
        return home / SCENARIO_ATTACHMENT


def _refuse_unresolved(recording: Path, scenario: bytes) -> None:
    """Raise RecordingFailed where a scenario takes programs or message types from elsewhere.

    A base could bring programs that `programs_in` does not see, and loading types from a module
    would execute it. No run records these: a recorded scenario is resolved.
    """
    try:
        data = parse_yaml(SCENARIO_ATTACHMENT, scenario.decode(errors="replace"))
    except SettingsError:
        return
    content = data if isinstance(data, dict) else {}
    if "extends" in content:
        raise RecordingFailed(f"{recording}: its scenario has the key 'extends': refused")
    given = content.get("types")
    for source in given if isinstance(given, list) else [given]:
        if isinstance(source, str) and not is_file_name(source):
            raise RecordingFailed(
                f"{recording}: its message types refer to the module {source!r}: refused"
            )


def _levels(name: str) -> int:
    """Return how many folders above the scenario's a file is."""
    parts = PurePosixPath(name).parts
    return next((n for n, part in enumerate(parts) if part != ".."), len(parts))


def trusted_sources(recording: Recording, trusted: str | None) -> Sources:
    """Return the sources of a recording, as `Sources.of`.

    trusted: fingerprint of the programs that may be started; None: any. Raises RecordingFailed
    where the recording has others.
    """
    sources = Sources.of(recording.path, recording.attachments)
    if trusted not in {None, sources.fingerprint}:
        raise RecordingFailed(f"{recording.path} has changed since it was checked; try again")
    return sources


def unpack_into(out: Path, sources: Sources) -> Path:
    """Write sources into the folder of a new run; raises OutputExists where it holds one."""
    if (out / "logs").exists() or (out / SOURCE_FOLDER).exists():
        raise OutputExists(f"{out} already contains a run; choose another {argument('--out')}")
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
