"""What the messages of a recorded run must be, whatever went wrong in it."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from campaign import log_reader
from campaign.log_reader import CALLS, CHAIN, Log, Row

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import layout
from stepbus_schemas import CHAIN_EVERY

from .execution import Execution
from .kinds import KINDS
from .tape import FOLDER, Tape


class Reference(NamedTuple):
    """An undisturbed run. rows: what it has recorded. places: topic → its rank within a step."""

    rows: Sequence[Row]
    by_topic: Mapping[str, Sequence[Row]]
    places: Mapping[str, int]


@cache
def reference(name: str, steps: int) -> Reference:
    """Return the undisturbed run of a scenario."""
    with TemporaryDirectory(dir=FOLDER) as folder:
        execution = Execution(Tape(name, steps), Path(folder) / "run")
        execution.run()
        result = execution.result
        assert result is not None, execution.crash
        assert result.exit_code == 0, result.reason
        log = log_reader.read(Path(folder) / "run" / "run.mcap")
    assert not log.damage, log.damage
    by_topic: dict[str, list[Row]] = {}
    for row in log.rows:
        by_topic.setdefault(row.topic, []).append(row)
    # A call precedes the outputs of its step.
    topics = sorted(by_topic, key=CALLS.__ne__)
    places = {topic: place for place, topic in enumerate(topics)}
    return Reference(log.rows, by_topic, places)


def judge_messages(execution: Execution, log: Log) -> Iterator[str]:
    """Yield what does not hold of the messages of a recording, in their order."""
    yield from _judge_rows(execution, log.rows)
    yield from _judge_chains(execution, log)
    yield from _judge_last_outputs(execution, log.rows)


def judge_incomplete(execution: Execution, log: Log) -> Iterator[str]:
    """Yield where a run that failed says otherwise than its messages what is not recorded.

    Each participant has one port.
    """
    tape, incomplete = execution.tape, log.metadata.get(layout.INCOMPLETE_METADATA, {})
    if log.rows and not (execution.watch.is_recorded or incomplete or on_disk(execution)):
        yield "the recording of a run that failed does not say what lacks"
    if execution.watch.replaced:
        return
    truth = reference(tape.scenario, tape.steps).rows
    for name, step in incomplete.items():
        recorded = [row.step for row in log.rows if row.topic.startswith(f"{name}/")]
        own = [row.step for row in truth if row.topic.startswith(f"{name}/")]
        # Where the run was to end early, some were ahead.
        known = [item for item in recorded if item <= own[-1]]
        if recorded[-1:] >= [int(step)] or known != [item for item in own if item < int(step)]:
            yield f"{name} is said to be incomplete from {step} on, and is not"


def on_disk(execution: Execution) -> bool:
    """Return whether the disk has failed."""
    return any(KINDS[fault.kind].codes == {ExitCode.RECORDING} for fault in execution.effective)


def _judge_rows(execution: Execution, rows: Sequence[Row]) -> Iterator[str]:
    """Yield where what is recorded is no beginning of the reference."""
    tape, result = execution.tape, execution.result
    truth = reference(tape.scenario, tape.steps)
    if result is not None and result.exit_code == 0:
        if list(rows) != list(truth.rows):
            yield f"finished, and recorded {len(rows)} messages that are not the reference's"
        elif result.messages_sha256 != hashlib.sha256(rows[-1].content).hexdigest():
            yield "the hash of the messages is not that of the last chain"
        return
    watch = execution.watch
    first_held = watch.held[0] if watch.replaced else tape.steps + 1
    ends_early = truth.rows[-1].step < tape.steps
    counts = dict.fromkeys(truth.by_topic, 0)
    before = (-1, -1)
    for row in rows:
        here = (row.step, truth.places.get(row.topic, -1))
        if here <= before:
            yield f"{row.topic} of step {row.step} is recorded behind step {before[0]}"
        before = here
        # The hash chain of a cut recording ends with what is there; after the end that one asked
        # for, some are ahead.
        is_ahead = ends_early and row.step >= truth.rows[-1].step
        if row.step >= first_held or is_ahead or row.topic == CHAIN:
            continue
        expected = truth.by_topic.get(row.topic, [])
        number = counts.get(row.topic, 0)
        counts[row.topic] = number + 1
        if number >= len(expected) or expected[number] != row:
            yield f"{row.topic} of step {row.step} is not what the reference has there"
            return


def _broken(execution: Execution) -> set[str]:
    """Return who may have published what cannot be recorded."""
    wrong = ("wrong", "bulk_short")
    return {fault.target for fault in execution.effective if fault.kind.startswith(wrong)}


def _judge_last_outputs(execution: Execution, rows: Sequence[Row]) -> Iterator[str]:
    """Yield where a run that failed did not record what had arrived of those that did not."""
    result = execution.result
    # A run that comes to its end, or to a safe stop, ends before what some had published already.
    if result is None or result.exit_code in (0, ExitCode.INTERRUPTED, ExitCode.STOP_TIMEOUT):
        return
    if execution.watch.replaced or on_disk(execution):
        return
    newest = {row.topic.partition("/")[0]: row.step for row in rows}
    spared = {result.participant, "camera", *_broken(execution)}
    state = execution.watch.state
    for name, reported in state.barrier.reported.items():
        # The run may have been asked to end while some were ahead.
        step = min(reported, state.last_step - 1)
        if name not in spared and newest.get(name, -1) < step:
            yield f"{name} had reported step {step}, and is recorded up to {newest.get(name)}"


def _judge_chains(execution: Execution, log: Log) -> Iterator[str]:
    """Yield where a hash chain is not what P13.3 says.

    One that is blamed may have published what cannot be recorded.
    """
    result = execution.result
    blamed = {None if result is None else result.participant, *_broken(execution)}
    for name, step in log.breaks():
        if name not in blamed:
            yield f"the chain of {name} is wrong at step {step}"
    chains = {row.step for row in log.rows if row.topic == CHAIN}
    due = set(range(CHAIN_EVERY - 1, log.last_step, CHAIN_EVERY))
    for step in sorted(due - chains):
        yield f"there is no chain at step {step}"
    for step in sorted(chains - due - {log.last_step}):
        yield f"there is a chain at step {step}"
