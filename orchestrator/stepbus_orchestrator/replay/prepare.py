"""From a recording to the scenario of its replay."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msgspec import structs

from stepbus_orchestrator.analysis.tolerance import short
from stepbus_orchestrator.errors import RecordingFailed, argument
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.recorded import replayable_steps
from stepbus_orchestrator.replay.trust import recorded_programs
from stepbus_orchestrator.replay.work_tree import WorkTree
from stepbus_orchestrator.run.folder import read_files
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario, low_latency
from stepbus_orchestrator.scenario.scenario_files import find_files
from stepbus_participant import suggest
from stepbus_schemas import WiringError

from .rerun import Origin, origin_of, refuse_others, unpack

_NO_PROGRAM = "[python]"
_MOST_CHANGES = 8


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """What is replayed.

    scenario: as recorded, but for the participant's program and parameters. files: those of the
    work tree, by name; None where the recording's are taken. is_changed: whether the scenario is
    not the recorded one. notes: how scenario and files differ from the recorded ones.
    """

    scenario: Scenario
    files: Mapping[str, Path] | None = None
    is_changed: bool = False
    notes: Sequence[str] = ()


def prepare(
    recording: Recording,
    participant: str,
    folder: Path,
    overrides: Sequence[str],
    *,
    own_program: bool,
    tree: WorkTree | None = None,
    trusted: str | None = None,
) -> Prepared:
    """Unpack a recording's scenario into a new folder and return it, as it was recorded.

    own_program: whether the participant's program is not the recorded one. tree: the scenario
    whose program and parameters the participant gets; None: the recorded ones. Programs that the
    replay does not start need not be there. trusted: fingerprint of the programs that may be
    started; None: any.

    Raises RecordingFailed when there is no scenario in it, WiringError when it has no such
    participant, ScenarioError when it cannot be replayed here.
    """
    origin = origin_of(recording)
    refuse_others(origin, trusted)
    programs = recorded_programs(recording)
    if participant not in programs:
        known = suggest(participant, programs)
        raise WiringError(f"{recording.path} has no participant {participant!r}{known}")
    path = unpack(origin, folder)
    is_other = own_program or tree is not None
    unused = [name for name in programs if is_other or name != participant]
    scenario = load(path, [*overrides, *(f"{name}.exec={_NO_PROGRAM}" for name in unused)])
    specs = [
        structs.replace(
            _with_program(spec, programs[spec.name]) if spec.name in unused else spec,
            on_fault="stop",
        )
        for spec in scenario.participants
    ]
    # What was recorded is what came of the faults; they are not injected once more.
    scenario = dataclasses.replace(scenario, participants=tuple(specs), faults=())
    if tree is None:
        return Prepared(scenario=scenario, is_changed=bool(overrides))
    return _from_tree(origin, scenario, participant, tree, overrides)


def _from_tree(
    origin: Origin, scenario: Scenario, participant: str, tree: WorkTree, overrides: Sequence[str]
) -> Prepared:
    """Return a recorded scenario with one participant as it is in the work tree."""
    names = [name for name in tree.programs if name != participant]
    unused = [f"{name}.exec={_NO_PROGRAM}" for name in names]
    today = load(tree.file, [*tree.overrides, *overrides, *unused])
    new, old = today.participant(participant), scenario.participant(participant)
    spec = structs.replace(
        old,
        participant=new.participant,
        exec=new.exec,
        bridge=new.bridge,
        params=new.params,
        **{key: getattr(new, key) for key in new.__struct_fields__ if key.endswith("_timeout_ns")},
    )
    specs = [spec if other is old else other for other in scenario.participants]
    today_files = find_files(_with_programs(today, tree, names)).paths
    values = list(_changed_values(old, new))
    return Prepared(
        scenario=dataclasses.replace(scenario, participants=tuple(specs), folder=tree.folder),
        files=today_files,
        is_changed=bool(overrides or values),
        notes=[
            *(argument("--set", value=text) for text in overrides),
            *_changed_files(origin.files, read_files(today_files)),
            *values,
            *_rewired(scenario, today, old, new),
        ],
    )


def _with_programs(today: Scenario, tree: WorkTree, names: Sequence[str]) -> Scenario:
    """Return a scenario in which some participants have the programs that the file says."""
    specs = (
        _with_program(spec, tree.programs[spec.name]) if spec.name in names else spec
        for spec in today.participants
    )
    return dataclasses.replace(today, participants=tuple(specs))


def _with_program(spec: ParticipantSpec, other: ParticipantSpec) -> ParticipantSpec:
    return structs.replace(spec, participant=other.participant, exec=other.exec)


def _changed_files(recorded: Mapping[str, bytes], today: Mapping[str, bytes]) -> Iterator[str]:
    for name in sorted({*recorded, *today}):
        if name not in today:
            yield f"{name} is only in the recording"
        elif name not in recorded:
            yield f"{name} is not in the recording"
        elif today[name] != recorded[name]:
            yield f"{name} is not the recorded one"


def _changed_values(old: ParticipantSpec, new: ParticipantSpec) -> Iterator[str]:
    values = [
        *_values("participant", old.participant, new.participant),
        *_values("exec", list(old.exec), list(new.exec)),
        *_values("bridge", old.bridge, new.bridge),
        *_values("params", old.params, new.params),
    ]
    yield from (f"{old.name}.{text}" for text in values[:_MOST_CHANGES])
    if len(values) > _MOST_CHANGES:
        yield f"{len(values) - _MOST_CHANGES} more values of {old.name} are not the recorded ones"


def _values(path: str, old: Any, new: Any) -> Iterator[str]:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in dict.fromkeys((*old, *new)):
            yield from _values(f"{path}.{key}", old.get(key), new.get(key))
    elif old != new:
        yield f"{path} is {_shown(new)}, recorded {_shown(old)}"


def _shown(value: Any) -> str:
    return "absent" if value is None else short(value)


def _rewired(
    scenario: Scenario, today: Scenario, old: ParticipantSpec, new: ParticipantSpec
) -> Iterator[str]:
    """Yield what the work tree connects or times otherwise, which a replay does not follow."""
    rows = {
        "step": (scenario.step_ns, today.step_ns),
        "seed": (scenario.seed, today.seed),
        **{
            f"{old.name}.{key}": (getattr(old, key), getattr(new, key))
            for key in ("every", "publishes", "inputs", "outputs")
        },
    }
    changed = [key for key, (was, now) in rows.items() if was != now]
    if changed:
        yield f"{', '.join(changed)}: not as recorded; replayed as recorded"


def shorten(scenario: Scenario, recording: Recording, participant: str, window: int) -> Scenario:
    """Return the scenario with the steps that can be replayed, and with another window.

    Raises RecordingFailed when the recording has none, or has a hole: who is replayed would be
    blamed for what was not recorded.
    """
    holes = recording.holes()
    if holes:
        raise RecordingFailed(f"{recording.path} has a hole: {'; '.join(holes)}")
    steps = replayable_steps(recording, scenario, participant)
    if not steps and recording.cut_short:
        raise RecordingFailed(
            f"{recording.path} has no complete step of {participant}: it {recording.cut_short}"
        )
    if not steps:
        raise RecordingFailed(
            f"{recording.path} has no complete step of {participant}: there is nothing to compare"
        )
    return dataclasses.replace(scenario, steps=steps, window=window, batch=max(1, window // 2))


def alone(scenario: Scenario, participant: str) -> Scenario:
    """Return a scenario of one participant, for the links on the bus."""
    bus = structs.replace(scenario.bus, low_latency=low_latency(scenario))
    specs = (scenario.participant(participant),)
    return dataclasses.replace(scenario, participants=specs, bus=bus)
