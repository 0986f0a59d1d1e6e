"""From a recording to the scenario of its replay."""

import dataclasses
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msgspec import structs, to_builtins

from stepbus_orchestrator.analysis.code import FileChange
from stepbus_orchestrator.analysis.code import changes as file_changes
from stepbus_orchestrator.analysis.tolerance import differences, short
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.plugins import scenario_reader
from stepbus_orchestrator.processes.slots import slot_counts
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.recorded import PROGRAM, check_whole, replayable_steps, rewired
from stepbus_orchestrator.replay.sources import Sources
from stepbus_orchestrator.run.folder import read_files
from stepbus_orchestrator.scenario.extend import participant_rows, read_extended
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario, low_latency
from stepbus_orchestrator.scenario.scenario_files import find_files
from stepbus_participant import suggest
from stepbus_participant.parameters import Keys, YamlFile
from stepbus_schemas import WiringError

_NO_PROGRAM = "[python]"


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """What is replayed.

    scenario: as recorded, but for the participant's program and parameters. files: those of the
    user's scenario, by name; None where the recording's are taken. is_changed: whether the scenario
    is not the recorded one. notes: how scenario and files differ from the recorded ones. code: the
    files that do, line by line.
    """

    scenario: Scenario
    files: Mapping[str, Path] | None = None
    is_changed: bool = False
    notes: Sequence[str] = ()
    code: Sequence[FileChange] = ()


def prepare(
    recording: Recording,
    participant: str,
    folder: Path,
    overrides: Sequence[str],
    *,
    own_program: bool,
    source: Path | None = None,
) -> Prepared:
    """Unpack a recording's scenario into a new folder and return it, as it was recorded.

    own_program: whether the participant's program is not the recorded one. source: the scenario
    whose program and parameters the participant gets; None: the recorded ones. Programs that the
    replay does not start need not be there.

    Raises RecordingFailed when there is no scenario in it, WiringError when it has no such
    participant, ScenarioError when it cannot be replayed here.
    """
    sources = Sources.of(recording)
    programs = _programs(recording.scenario)
    if participant not in programs:
        known = suggest(participant, programs)
        raise WiringError(f"{recording.path} has no participant {participant!r}{known}")
    is_other = own_program or source is not None
    started = "" if is_other else participant
    scenario = _load(sources.unpack(folder), overrides, programs, started)
    # What was recorded is what came of the faults; they are not injected once more.
    specs = tuple(structs.replace(spec, on_fault="stop") for spec in scenario.participants)
    scenario = dataclasses.replace(scenario, participants=specs, faults=())
    if source is None:
        return Prepared(scenario=scenario, is_changed=bool(overrides))
    return _from_source(sources.files, scenario, participant, source, overrides)


def _programs(scenario: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the keys `participant` and `exec` of each participant, as a scenario has them."""
    return {
        name: {
            "participant": str(row.get("participant") or ""),
            "exec": tuple(map(str, row.get("exec") or ())),
        }
        for name, row in participant_rows(scenario).items()
    }


def _load(
    path: Path, overrides: Sequence[str], programs: Mapping[str, Mapping[str, Any]], started: str
) -> Scenario:
    """Return a scenario; the programs of those that are not started need not be here.

    But files of other tools, such as FMUs: the ports of their participants are in them.
    """
    unused = [
        name
        for name, row in programs.items()
        if name != started and scenario_reader(row["participant"]) is None
    ]
    scenario = load(path, [*overrides, *(f"{name}.exec={_NO_PROGRAM}" for name in unused)])
    specs = [
        structs.replace(spec, **programs[spec.name]) if spec.name in unused else spec
        for spec in scenario.participants
    ]
    return dataclasses.replace(scenario, participants=tuple(specs))


def _from_source(
    recorded_files: Mapping[str, bytes],
    scenario: Scenario,
    participant: str,
    source: Path,
    overrides: Sequence[str],
) -> Prepared:
    """Return a recorded scenario with one participant as it is in the user's scenario."""
    today = _load(source, overrides, _programs(read_extended(source).data), participant)
    new, old = today.participant(participant), scenario.participant(participant)
    timeouts = (key for key in new.__struct_fields__ if key.endswith("_timeout_ns"))
    spec = structs.replace(old, **{key: getattr(new, key) for key in (*PROGRAM, *timeouts)})
    specs = [spec if other is old else other for other in scenario.participants]
    today_files = find_files(today).paths
    sides = ("recorded", "tested")
    code = file_changes(recorded_files, read_files(today_files), sides)
    values = list(_changed_values(old, new, read_extended(source)))
    kept = ", ".join(rewired(scenario, today, [participant]))
    unused = f"{kept}: changed since the recording; the replay uses the recorded values"
    return Prepared(
        scenario=dataclasses.replace(scenario, participants=tuple(specs), folder=source.parent),
        files=today_files,
        is_changed=bool(overrides or values),
        notes=[
            *(f"--set {text}" for text in overrides),
            *(_file_note(change) for change in code),
            *values,
            *([unused] if kept else []),
        ],
        code=code,
    )


def _file_note(change: FileChange) -> str:
    what = f": {change.what}" if change.what else ""
    return f"{change.place} differs from the recorded one{what}"


def _changed_values(old: ParticipantSpec, new: ParticipantSpec, file: YamlFile) -> Iterator[str]:
    """Yield how the program and the parameters differ, and where the scenario has them."""
    for key in PROGRAM:
        recorded, today = (to_builtins(getattr(spec, key)) for spec in (old, new))
        for item in differences(f"{old.name}.{key}", recorded, today, None):
            now, was = (
                "absent" if value is None else short(value) for value in (item.second, item.first)
            )
            yield f"{item.path} is {now}, recorded {was}{_place(file, item.path)}"


def _place(file: YamlFile, path: str) -> str:
    """Return where a scenario has the value at a path such as `plant.params.q0[1]`, in brackets."""
    words = ("participants", *re.findall(r"[^.\[\]]+", path))
    keys: Keys = tuple(int(word) if word.isdecimal() else word for word in words)
    # What is gone, or is a default, is missing below one of these.
    known = (keys[:n] for n in range(len(keys), 1, -1) if keys[:n] in file.places)
    place = next(map(file.places.__getitem__, known), None)
    return f" ({place})" if place else ""


def shorten(scenario: Scenario, recording: Recording, participant: str, window: int) -> Scenario:
    """Return the scenario with the steps that can be replayed, and with another window.

    Raises RecordingFailed when the recording has none, has a hole, or lacks what the participant
    reads: it would be blamed for what was not recorded.
    """
    check_whole(recording, scenario, [participant])
    steps = replayable_steps(recording, scenario, participant)
    if not steps:
        cut = recording.cut_short
        raise RecordingFailed(
            f"{recording.path} has no complete step of {participant}: "
            f"{f'it {cut}' if cut else 'there is nothing to compare'}"
        )
    # Bulk content is played in messages, whatever it has been recorded from.
    is_quick = low_latency(scenario) and not slot_counts(scenario)
    bus = structs.replace(scenario.bus, low_latency=is_quick)
    batch = max(1, window // 2)
    return dataclasses.replace(scenario, steps=steps, window=window, batch=batch, bus=bus)
