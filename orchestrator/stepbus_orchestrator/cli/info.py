"""`stepbus info`: what is in a recording, in ten lines; `recover`: rebuild a damaged one."""

import contextlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from stepbus_orchestrator.cli import commands
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.recording import Recording, Recovery, layout, recover
from stepbus_orchestrator.recording.recover import planned_steps
from stepbus_orchestrator.replay.recorded import recorded_end
from stepbus_orchestrator.run.result import RESULT_FILE, result_beside
from stepbus_orchestrator.scenario.extend import participant_rows
from stepbus_orchestrator.scenario.ports import RECORD_ALL
from stepbus_participant import parse_duration
from stepbus_schemas import Event, StepbusError

_MOST_TYPES, _MOST_TOPICS = 4, 3
_MAIN = ("python", "stepbus")
_OF_MACHINE = ("machine", "cpu")
_OF_EVERY_RUN = (layout.CHAIN_TYPE, layout.CALLS_TYPE)


class TypeCount(msgspec.Struct, frozen=True, kw_only=True):
    """The ports of one message type: their topics, and how many messages they have together."""

    type: str
    topics: Sequence[str]
    messages: int


class Info(msgspec.Struct, frozen=True, kw_only=True):
    """What is in a recording.

    outcome, reason, wall_s: of the result.json of this run, if it is there. planned_steps: of the
    scenario; None: no fixed end. steps: with messages. cut_short: why it ends where it does.
    incomplete: participant → first step whose outputs are missing. holes: gaps between its
    messages. partly: topic that is not recorded whole → how it is. programs: what was started.
    versions: name → library → version. events: level → how many. size: of the recording [bytes];
    folder_size: with all that is beside it, where it is in the folder of a run. duration_s: length
    in simulated time [s].
    """

    recording: str
    scenario: str
    outcome: str
    reason: str
    steps: int
    planned_steps: int | None
    step_ns: int | None
    wall_s: float | None
    cut_short: str
    incomplete: Mapping[str, int]
    holes: Sequence[str]
    programs: Mapping[str, str]
    ports: Sequence[TypeCount]
    partly: Mapping[str, str]
    events: Mapping[str, int]
    faults: Sequence[str]
    size: int
    folder_size: int | None
    versions: Mapping[str, Mapping[str, str]]
    messages_sha256: str
    duration_s: float | None


def info_command(given: commands.Info) -> Answer:
    """Return what is in a recording."""
    with Recording(given.recording) as opened:
        found = _info(opened)
    return Answer(value=found, lines=[line.replace("\n", " ") for line in _lines(found)])


def _info(recording: Recording) -> Info:
    # It reads all messages, and with them any damage.
    holes = recording.holes()
    scenario, result = recording.scenario, result_beside(recording)
    step_ns = None
    with contextlib.suppress(StepbusError):
        step_ns = parse_duration(str(scenario.get("step")))
    beside = recording.path.parent
    missing = recording.incomplete
    is_run = recording.path.name == layout.RUN_FILE and (beside / layout.TIMING_FILE).exists()
    faults = recording.metadata.get(layout.FAULTS_METADATA, {})
    ended = None if recording.cut_short else result
    files = beside.rglob("*") if is_run else ()
    steps = ended.steps if ended else min((recorded_end(recording), *missing.values()))
    return Info(
        recording=str(recording.path),
        scenario=str(scenario.get("name") or ""),
        outcome=result.outcome if result else "",
        reason=result.reason if result else "",
        steps=steps,
        planned_steps=planned_steps(scenario),
        step_ns=step_ns,
        wall_s=result.wall_s if result else None,
        cut_short=recording.cut_short,
        incomplete=missing,
        holes=holes,
        programs={name: _program(row) for name, row in participant_rows(scenario).items()},
        ports=_ports(recording),
        partly={t: p.record for t, p in recording.ports.items() if p.record != RECORD_ALL},
        events=_events(recording),
        faults=list(faults.values()),
        size=recording.path.stat().st_size,
        folder_size=sum(file.stat().st_size for file in files if file.is_file()) or None,
        versions=layout.versions_of(recording.metadata),
        messages_sha256=recording.messages_sha256,
        duration_s=steps * step_ns * 1e-9 if step_ns else None,
    )


def _program(row: Mapping[str, Any]) -> str:
    """Return the program that is started as a participant."""
    if "participant" in row:
        return f"Python {row['participant']}"
    words = row.get("exec")
    program = " ".join(map(str, words)) if isinstance(words, list) else str(words or "external")
    bridge = row.get("bridge")
    form = bridge.get("format", "json") if isinstance(bridge, dict) else bridge
    return f"{program} (bridge {form})" if bridge else program


def _ports(recording: Recording) -> list[TypeCount]:
    counts, types = recording.counts, dict[str, list[str]]()
    for topic, port in recording.ports.items():
        if port.type not in _OF_EVERY_RUN:
            types.setdefault(port.type, []).append(topic)
    return [
        TypeCount(type=name, topics=topics, messages=sum(counts[topic] for topic in topics))
        for name, topics in types.items()
    ]


def _events(recording: Recording) -> Counter[str]:
    levels: Counter[str] = Counter()
    for port in recording.of_type("Event/1"):
        with contextlib.suppress(StepbusError):
            levels.update(m.level for _, m in port.messages() if isinstance(m, Event))
    return levels


def _lines(info: Info) -> Iterator[str]:
    more = f"; {shown_size(info.folder_size)} in the run folder" if info.folder_size else ""
    yield f"recording {info.recording}, {shown_size(info.size)}{more}"
    yield f"scenario  {info.scenario or 'none recorded'}"
    yield f"outcome   {_outcome(info)}"
    yield f"length    {_length(info)}"
    yield from (f"hole      {hole}" for hole in info.holes)
    programs = ", ".join(f"{name} ({program})" for name, program in info.programs.items())
    yield f"programs  {programs or 'none recorded'}"
    yield from _messages(info)
    levels = ", ".join(f"{count} {level}" for level, count in info.events.items())
    yield f"events    {levels or 'none'}; faults injected: {', '.join(info.faults) or 'none'}"
    yield f"versions  {_versions(info.versions)}"
    yield (
        f"hash      {info.messages_sha256 or 'none: the hash chain does not cover the last step'}"
    )


def shown_size(size: int) -> str:
    """Return a size [bytes] as people read it."""
    if size >= 1e9:
        return f"{size / 1e9:.1f} GB"
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"


def _outcome(info: Info) -> str:
    if info.cut_short:
        ending = f"cut short: it {info.cut_short}"
    elif info.outcome:
        ending = info.outcome + (f": {info.reason}" if info.reason != info.outcome else "")
    else:
        kind = "recording with holes" if info.holes else "complete recording"
        ending = f"{kind}; outcome unknown without its {RESULT_FILE}"
    rows = ", ".join(f"{name} from step {step}" for name, step in info.incomplete.items())
    return f"{ending}; missing outputs: {rows}" if rows else ending


def _length(info: Info) -> str:
    of = f" of {info.planned_steps}" if info.planned_steps not in {None, info.steps} else ""
    text = f"{info.steps}{of} steps"
    if info.step_ns and info.duration_s is not None:
        text += f" of {info.step_ns * 1e-6:g} ms = {info.duration_s:g} s"
    if info.wall_s:
        text += f", in {info.wall_s:.2f} s of wall time ({info.steps / info.wall_s:.0f} steps/s)"
    return text


def _messages(info: Info) -> Iterator[str]:
    """Yield how many messages there are, and the types with most of them, in two lines."""
    total = sum(row.messages for row in info.ports)
    ports = sum(len(row.topics) for row in info.ports)
    rate = f", {total / info.duration_s:.3g}/s" if info.duration_s else ""
    yield f"messages  {total} of {ports} ports{rate}"
    most = sorted(info.ports, key=lambda row: -row.messages)
    shown = [
        f"{row.messages} {row.type} ({', '.join(row.topics[:_MOST_TOPICS])}"
        f"{' …' * (len(row.topics) > _MOST_TOPICS)})"
        for row in most[:_MOST_TYPES]
    ]
    left = len(most) - len(shown)
    more = [f"{left} more (--json)"] if left else []
    if shown:
        yield f"types     {', '.join([*shown, *more])}"
    if info.partly:
        rows = [f"{topic} {record}" for topic, record in info.partly.items()]
        yield f"recorded  all but {', '.join(rows)}"


def _versions(versions: Mapping[str, Mapping[str, str]]) -> str:
    """Return the versions of Python and stepbus, how many others there are, and the machine."""
    own = versions.get(layout.ORCHESTRATOR, {})
    libraries = {library for row in versions.values() for library in row}
    left = len(libraries.difference(_MAIN, _OF_MACHINE))
    rows = [f"{library} {own[library]}" for library in _MAIN if library in own]
    rows += [f"{left} libraries (--json)"] if left else []
    return ", ".join([*rows, *(own[key] for key in _OF_MACHINE if key in own)]) or "none recorded"


def recover_command(given: commands.Recover) -> Answer:
    """Rebuild the recording, and return what was lost."""
    source = layout.recording_file(given.recording)
    target = given.out or source.with_name(f"{source.stem}.recovered.mcap")
    recovery = recover(source, source if given.in_place else target, in_place=given.in_place)
    value = {**vars(recovery), "missing_steps": recovery.missing_steps}
    return Answer(value=value, lines=_recovered(recovery))


def _recovered(recovery: Recovery) -> Iterator[str]:
    """Yield what was kept and what was lost, in sentences."""
    is_cut = recovery.cut_step is not None
    state = "it has holes" if recovery.holes else "undamaged"
    state = recovery.damage or ("it ends in the middle of a step" if is_cut else state)
    yield f"{recovery.source}: {state}"
    kept = f"{recovery.messages} messages up to step {recovery.last_step}"
    yield (
        f"kept {kept if recovery.messages else 'no messages'}; attachments: "
        f"{recovery.attachments}, metadata records: {recovery.metadata}"
    )
    if recovery.cut_step is not None:
        yield layout.incomplete(recovery.cut_step)
    if recovery.damage:
        yield _loss(recovery)
    yield from (f"hole: {hole}" for hole in recovery.holes)
    yield f"wrote {recovery.target}"


def _loss(recovery: Recovery) -> str:
    if recovery.only_index_lost:
        return f"lost only the index ({recovery.lost_bytes} bytes), which was rebuilt"
    lost = f"lost the last {recovery.lost_bytes} bytes, from byte {recovery.kept_bytes} on"
    if recovery.planned_steps is None:
        return lost
    return (
        f"{lost}; {recovery.missing_steps} of the scenario's {recovery.planned_steps} steps "
        "are missing"
    )
