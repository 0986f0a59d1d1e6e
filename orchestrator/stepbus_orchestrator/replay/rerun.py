"""Runs a recording's scenario again from nothing but the recording."""

import hashlib
import os
import re
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path, PurePosixPath

from stepbus_orchestrator.analysis.diff import Diff, diff
from stepbus_orchestrator.errors import OutputExists, RecordingFailed, argument
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.recording.layout import SCENARIO_ATTACHMENT, Source, recording_file
from stepbus_orchestrator.replay.prefix import RecordedPrefix
from stepbus_orchestrator.replay.recorded import counts_from_of, recorded_end
from stepbus_orchestrator.run.extensions.calls import Calls, recorded_calls
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import Result, file_sha256, own_versions
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.override import Overrides, override_texts
from stepbus_orchestrator.scenario.program import command
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_participant import SettingsError, make_folder, make_new_folder, write_file
from stepbus_participant.parameters import is_file_name, parse_yaml
from stepbus_schemas import CallRecord

SOURCE_FOLDER = "source"
_PROGRAMS = (b"#!", b"\x7fELF")
_PACKAGE_URL = re.compile(rb"package://[^\s\"'<>,\]})]+")
_LEVEL = "scenario_folder"
_OURS = ("python", "stepbus")


@dataclass(frozen=True, kw_only=True)
class Origin:
    """What a recording holds of where it comes from.

    files: name → content, without the scenario. versions: `orchestrator` or participant →
    library → version; `cpu` and `machine` are among those of the orchestrator. steps: the newest
    one with a message, plus one. end: the number of complete steps. flaws: damage and
    holes. calls: those that changed the run. counts_from: of a branch, the participants that were
    changed at a step.
    """

    recording: Path
    scenario: bytes
    files: Mapping[str, bytes]
    versions: Mapping[str, Mapping[str, str]]
    steps: int
    end: int
    flaws: Sequence[str]
    calls: Sequence[CallRecord] = ()
    counts_from: Mapping[str, int] = field(default_factory=dict)


def read_origin(recording: Path) -> Origin:
    """Read what a run needs from its recording, which may be cut off behind it.

    Raises RecordingFailed when the file is none, or as `origin_of` does.
    """
    return origin_of(Recording(recording))


def origin_of(recording: Recording) -> Origin:
    """Return what a run needs from its recording.

    Raises RecordingFailed when that holds no scenario, or a file whose name leads out of its
    folder.
    """
    scenario, files = attached(recording)
    return Origin(
        recording=recording.path,
        scenario=scenario,
        files=files,
        versions={
            owner: content
            for name, content in recording.metadata.items()
            if (owner := layout.versions_owner(name)) is not None
        },
        steps=1 + recording.last_step,
        end=recorded_end(recording),
        flaws=recording.flaws(),
        calls=recorded_calls(recording),
        counts_from=counts_from_of(recording),
    )


def fingerprint(scenario: bytes, files: Mapping[str, bytes]) -> str:
    """Return the SHA-256 of all that a recording can start: its scenario, and files by name."""
    digest = hashlib.sha256()
    for name, content in [("", scenario), *sorted(files.items())]:
        for part in (name.encode(errors="surrogateescape"), content):
            digest.update(len(part).to_bytes(8, "little"))
            digest.update(part)
    return digest.hexdigest()


def attached(recording: Recording) -> tuple[bytes, Mapping[str, bytes]]:
    """Return the scenario that a recording holds, and its files; raises as `origin_of`."""
    return attached_files(recording.path, recording.attachments)


def attached_files(
    recording: Path, attachments: Mapping[str, bytes]
) -> tuple[bytes, Mapping[str, bytes]]:
    """Return the scenario among the attachments of a recording, and its files.

    Raises as `origin_of`.
    """
    if SCENARIO_ATTACHMENT not in attachments:
        raise RecordingFailed(
            f"{recording} holds no {SCENARIO_ATTACHMENT}: is it the run.mcap of a run?"
        )
    files = _files(recording, attachments)
    scenario = attachments[SCENARIO_ATTACHMENT]
    _refuse_modules(recording, scenario)
    return scenario, files


def _refuse_modules(recording: Path, scenario: bytes) -> None:
    """Raise RecordingFailed where a scenario would import a module: loading it would execute code.

    No run records one: message types of a module are recorded in full.
    """
    try:
        data = parse_yaml(SCENARIO_ATTACHMENT, scenario.decode(errors="replace"))
    except SettingsError:
        return
    given = data.get("types") if isinstance(data, dict) else None
    for source in given if isinstance(given, list) else [given]:
        if isinstance(source, str) and not is_file_name(source):
            raise RecordingFailed(f"{recording}: its types name the module {source!r}: refused")


def _files(recording: Path, attachments: Mapping[str, bytes]) -> dict[str, bytes]:
    files = {
        name: data
        for attachment, data in attachments.items()
        if (name := layout.attached_file(attachment)) is not None
    }
    for name in files:
        path = PurePosixPath(name)
        below = path.parts[_levels(name) :]
        if path.is_absolute() or ".." in below or not below or "\0" in name:
            raise RecordingFailed(f"{recording}: attached file {name!r} leads out of its folder")
    return files


def _levels(name: str) -> int:
    """Return how many folders above the scenario's a file is."""
    parts = PurePosixPath(name).parts
    return next((n for n, part in enumerate(parts) if part != ".."), len(parts))


def refuse_others(origin: Origin, trusted: str | None) -> None:
    """Raise RecordingFailed where a recording has other programs than those that may be started."""
    if trusted not in {None, fingerprint(origin.scenario, origin.files)}:
        raise RecordingFailed(f"{origin.recording} has changed since it was checked; try again")


def unpack(origin: Origin, folder: Path) -> Path:
    """Write the scenario and its files to a new folder and return the scenario's path.

    Raises RecordingFailed when they cannot be written.
    """
    return unpack_files(origin.scenario, origin.files, folder)


def unpack_files(scenario: bytes, files: Mapping[str, bytes], folder: Path) -> Path:
    """Write a scenario and its files to a new folder and return the scenario's path.

    Where files are in folders above the scenario's (`../models/arm.urdf`), the scenario is as many
    levels below the new folder. Raises RecordingFailed when they cannot be written.
    """
    levels = max(map(_levels, files), default=0)
    home = folder.joinpath(*[_LEVEL] * levels)
    path = home / SCENARIO_ATTACHMENT
    try:
        make_new_folder(folder)
        make_folder(home)
        for name, content in files.items():
            file = Path(os.path.normpath(home / name))
            make_folder(file.parent)
            write_file(file, content, 0o755 if content.startswith(_PROGRAMS) else 0o644)
        write_file(path, scenario)
    except OSError as exc:
        raise RecordingFailed(
            f"{exc.filename or folder} cannot be written: {exc.strerror}; "
            f"choose another {argument('--out')}"
        ) from exc
    return path


@dataclass(frozen=True, kw_only=True)
class Rerun:
    """A run made from a recording.

    recorded_sha256: of the recording it was made from. recorded_steps: how many steps that has.
    is_part: whether it is cut off, has a hole, or ended before its scenario does. flaws: its damage
    and holes. notes: what may make it different, one sentence each, its flaws among them.
    """

    recording: Path
    recorded_sha256: str
    result: Result
    recorded_steps: int = 0
    is_part: bool = False
    flaws: Sequence[str] = ()
    notes: Sequence[str] = field(default=())

    @property
    def equal(self) -> bool:
        """Return whether the new recording is the old one, byte for byte."""
        return self.recorded_sha256 == self.result.sha256

    @property
    def compares(self) -> bool:
        """Return whether there is anything to compare: steps in both."""
        return bool(self.recorded_steps and self.result.steps)

    def diff(self) -> Diff:
        """Compare what both have: of a recording that is cut off, up to its end."""
        return diff(self.recording, self.result.recording, is_part=self.is_part)


class Preparation:
    """A run from a recording that is about to start; its files are unpacked in `out/source`.

    overrides: settings such as `window=1`. trusted: fingerprint of the programs that may be
    started; None: any. notes: what may make it different from the recorded one.
    Raises RecordingFailed when the recording is not fit for it or `out` holds a run already,
    and ScenarioError when the scenario cannot run here.
    """

    def __init__(
        self,
        recording: Path,
        out: Path,
        overrides: Sequence[str] = (),
        *,
        trusted: str | None = None,
    ) -> None:
        self._origin = read_origin(recording)
        refuse_others(self._origin, trusted)
        self._out = out
        self._is_changed = bool(overrides)
        if (out / "logs").exists() or (out / SOURCE_FOLDER).exists():
            raise OutputExists(f"{out} holds a run already; choose another {argument('--out')}")
        path = unpack(self._origin, out / SOURCE_FOLDER)
        self.scenario = load(path, overrides)
        recorded = self._origin.versions.get(layout.ORCHESTRATOR, {})
        self.notes = [
            *_damage(self._origin),
            *_changes(self._origin, self.scenario, overrides),
            *_open_end(self._origin, self.scenario),
            *version_notes("the orchestrator", recorded, own_versions()),
            *_outside(self._origin, self.scenario),
        ]

    def run(
        self, observer: Observer | None = None, interrupt: threading.Event | None = None
    ) -> Rerun:
        """Run, and compare with the recording; observer, interrupt: as of `run`."""
        extensions = [*self._prefix(), Calls(self._origin.calls)]
        options = Options(out=self._out, extensions=extensions)
        result = run(self.scenario, options, observer, interrupt)
        now = read_origin(result.recording).versions
        later = [
            note
            for name, recorded in self._origin.versions.items()
            if name != layout.ORCHESTRATOR and name in now
            for note in version_notes(name, recorded, now[name])
        ]
        return Rerun(
            recording=self._origin.recording,
            recorded_sha256=file_sha256(self._origin.recording),
            result=result,
            recorded_steps=self._origin.end,
            is_part=self._is_part(result),
            flaws=self._origin.flaws,
            notes=[*self.notes, *later],
        )

    def _prefix(self) -> list[RecordedPrefix]:
        """Return the steps that a branch has from its recording; only there can they come from."""
        changed = self._origin.counts_from
        if not changed:
            return []
        recording = Recording(self._origin.recording)
        return [RecordedPrefix(recording, max(changed.values()), changed)]

    def _is_part(self, result: Result) -> bool:
        """Return whether the recording has less than this run without being different."""
        if self._origin.flaws:
            return True
        planned = self.scenario.steps
        is_short = planned is not None and self._origin.end < planned
        return is_short and not self._is_changed and self._origin.end < result.steps


def rerun(
    recording: Source,
    out: str | PathLike[str],
    *,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> Rerun:
    """Run the scenario of a recording again, from nothing but the recording.

    recording: the run.mcap of a run, or its folder. out: folder of the new run. set: override one
    value, e.g. window=1; may be repeated. observer, interrupt: as of `run`.

    Raises RecordingFailed when the recording holds no scenario, OutputExists when `out` holds a
    run.
    """
    preparation = Preparation(recording_file(recording), Path(out), override_texts(set))
    return preparation.run(observer, interrupt)


def _damage(origin: Origin) -> list[str]:
    return [f"the recording {flaw}" for flaw in origin.flaws]


_OTHER_VERSION = "this version reads it differently"


def _changes(origin: Origin, scenario: Scenario, overrides: Sequence[str]) -> list[str]:
    if resolved(scenario).encode() == origin.scenario:
        return []
    cause = argument("--set", value=" ".join(overrides)) if overrides else _OTHER_VERSION
    return [f"the scenario is not the recorded one: {cause}"]


def _open_end(origin: Origin, scenario: Scenario) -> list[str]:
    if scenario.steps is not None:
        return []
    note = (
        f"the scenario has no duration, the recording has {origin.steps} steps; if no participant "
        "ends the run, end it with Ctrl-C or give it one with "
        f"{argument('--set', value='duration=…')}"
    )
    return [note]


def version_notes(who: str, recorded: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Return a sentence for each thing that is another than it was."""
    return [
        f"{who} ran with {name} {recorded.get(name, 'absent')}, now it is {now.get(name, 'absent')}"
        for name in sorted({*recorded, *now})
        if recorded.get(name) != now.get(name)
    ]


def _outside(origin: Origin, scenario: Scenario) -> list[str]:
    """Return a sentence for each file that the run takes from this machine."""
    contents = [origin.scenario, *origin.files.values()]
    urls = {url.decode(errors="replace") for text in contents for url in _PACKAGE_URL.findall(text)}
    packages = tuple(f"/{url.removeprefix('package://')}" for url in urls)
    kept = {package for package in packages if any(f"/{f}".endswith(package) for f in origin.files)}
    urls = {url for url in urls if f"/{url.removeprefix('package://')}" not in kept}
    programs = {
        command(spec.program, scenario.folder)[0]
        for spec in scenario.participants
        if spec.program[0] not in _OURS
    }
    outside = {path for path in programs if not Path(path).is_relative_to(scenario.folder)}
    return [
        f"not in the recording, taken from this machine: {name}" for name in sorted(urls | outside)
    ]
