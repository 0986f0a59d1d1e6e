"""`stepbus recover`: rebuild a recording that is cut off or corrupt."""

from collections.abc import Iterator

from stepbus_orchestrator.cli.commands import Recover
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.recording import Recovery, layout, recover


def recover_command(given: Recover) -> Answer:
    """Rebuild the recording, and return what was lost."""
    source = layout.recording_file(given.recording)
    target = given.out or source.with_name(f"{source.stem}.recovered.mcap")
    recovery = recover(source, source if given.in_place else target, in_place=given.in_place)
    value = {**vars(recovery), "missing_steps": recovery.missing_steps}
    return Answer(value=value, lines=_lines(recovery))


def _lines(recovery: Recovery) -> Iterator[str]:
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
