"""What must hold of every simulated run, whatever went wrong in it."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from campaign import log_reader
from campaign.log_reader import Log, Row

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import layout, recover
from stepbus_orchestrator.recording.recover import Recovery
from stepbus_orchestrator.run.result import Result
from stepbus_schemas import StepbusError

from .execution import Execution
from .follow_up import FollowUp
from .judge_messages import Reference, judge_incomplete, judge_messages, on_disk, reference
from .kinds import CRASHES, KINDS, UNSEEN, culprits, lasting_ns
from .programs import STEP_NS, scenario
from .tape import MS, ORCHESTRATOR, Fault, Knobs
from .world import NS

_TIME = re.compile(r"step (\d+) \(t = ([\d.]+) s\)")
_AT_STEP = ("raise", "wrong_message")
_FILES = {"logs", "result.json", "run.mcap", "timing.mcap"}
_DATA_END = b"\x0f\x04\0\0\0\0\0\0\0"
_LOSS_NS = int(0.3 * NS)
"""What a killed orchestrator may lose: 0.25 s, and a turn."""


def judge(execution: Execution) -> Iterator[str]:
    """Yield what does not hold of a run that has been executed."""
    if execution.crash:
        yield f"an error of ours: {execution.crash.strip().splitlines()[-1]}"
    if execution.late:
        yield f"not ended in time: {', '.join(execution.late)}"
    if any(fault.kind in CRASHES for fault in execution.effective):
        yield from _judge_crash(execution)
        return
    yield from _judge_verdict(execution)
    yield from _judge_recording(execution)
    if execution.out.exists():
        left = {path.name for path in execution.out.iterdir()} - _FILES
        if left:
            yield f"left behind: {', '.join(sorted(left))}"


# --- the verdict ------------------------------------------------------------------------------


def _harmful(execution: Execution) -> list[Fault]:
    """Return what has struck, and may have done harm."""
    tape = execution.tape
    struck = [fault for fault in tape.faults if fault in execution.effective]
    total_ns = sum(lasting_ns(fault, tape.knobs) for fault in struck)
    return [f for f in struck if not KINDS[f.kind].is_harmless(f, tape.knobs, total_ns)]


def _judge_verdict(execution: Execution) -> Iterator[str]:
    harmful = _harmful(execution)
    participants = scenario(execution.tape.scenario, execution.tape.steps, Knobs()).participants
    names = [spec.name for spec in participants]

    def readers(name: str) -> set[str]:
        return {
            spec.name
            for spec in participants
            if any(item.source == name for item in spec.inputs.values())
        }

    allowed = {ExitCode.FINISHED, *(code for f in harmful for code in KINDS[f.kind].codes)}
    if any(_is_behind_end(execution, fault) for fault in harmful):
        allowed.add(ExitCode.DIED)
    if execution.refusal is not None:
        code = getattr(execution.refusal, "code", None)
        if code not in allowed:
            yield f"refused with {code}: {execution.refusal}"
        return
    result = execution.result
    if result is None:
        if not execution.crash:
            yield "there is no result"
        return
    if result.exit_code not in allowed:
        expected = sorted(map(int, allowed))
        yield f"exit code {result.exit_code}, not one of {expected}: {result.reason}"
    elif result.exit_code == 0 and any(KINDS[fault.kind].is_fatal for fault in harmful):
        yield f"finished, in spite of {', '.join(map(str, harmful))}"
    yield from _judge_step(execution, result, harmful)
    blamed = {name for fault in harmful for name in culprits(fault, names, readers)}
    if result.participant is not None and result.participant not in blamed:
        yield f"{result.participant} is blamed, not one of {sorted(blamed)}: {result.reason}"


def _is_behind_end(execution: Execution, fault: Fault) -> bool:
    """Return whether a participant was ahead of the end that another one, or itself, asked for."""
    tape = execution.tape
    end = reference(tape.scenario, tape.steps).rows[-1].step
    return fault.kind in _AT_STEP and end < tape.steps and fault.at >= end


def _judge_step(execution: Execution, result: Result, harmful: Sequence[Fault]) -> Iterator[str]:
    """Yield where an error names a step wrongly."""
    for step, t_s in _TIME.findall(result.reason):
        if round(float(t_s) * 1000) != int(step) * STEP_NS // MS:
            yield f"step {step} is not at {t_s} s: {result.reason}"
    if (
        result.exit_code
        and len(harmful) == 1
        and harmful[0].kind in _AT_STEP
        and not _is_behind_end(execution, harmful[0])
    ):
        struck = harmful[0].at - harmful[0].at % execution.every(harmful[0].target)
        if result.at_step != struck:
            yield f"step {result.at_step} is blamed, not {struck}: {result.reason}"


# --- what is recorded -------------------------------------------------------------------------


def _judge_recording(execution: Execution) -> Iterator[str]:
    path, result = execution.out / "run.mcap", execution.result
    if not path.exists():
        if not on_disk(execution):
            yield "there is no recording"
        return
    log = log_reader.read(path)
    if log.damage and result is not None and not on_disk(execution):
        yield f"the recording cannot be read: {log.damage}"
    try:
        recovery, kept = _recovered(path)
    except StepbusError as exc:
        if not on_disk(execution):
            yield f"cannot be recovered: {exc}"
        return
    has_our_chunks = execution.tape.knobs.chunk_bytes == Knobs().chunk_bytes
    if not (log.damage or recovery.damage) and has_our_chunks and kept.sha256 != log.sha256:
        yield "recover has made something else of a whole recording"
    yield from _judge_recovery(execution, recovery, kept)
    if not log.damage and kept.rows != log.rows:
        yield f"recover kept {len(kept.rows)} messages of {len(log.rows)}"
    yield from judge_messages(execution, kept)
    yield from judge_incomplete(execution, kept)
    yield from _judge_safe_stop(execution, kept.rows)
    if execution.tape.then and not execution.watch.replaced:
        yield from _judge_follow_up(execution, kept.rows)


def _recovered(path: Path) -> tuple[Recovery, Log]:
    """Return what `recover` says of a recording, and what the file that it makes holds."""
    saved = path.parent.with_name("saved.mcap")
    recovery = recover(path, saved)
    return recovery, log_reader.read(saved)


def _judge_recovery(execution: Execution, recovery: Recovery, kept: Log) -> Iterator[str]:
    """Yield where `recover` says something else than what it has kept."""
    if not kept.rows:
        return
    last = kept.last_step
    said = recovery.messages, recovery.last_step, recovery.planned_steps
    if said != (len(kept.rows), last, execution.tape.steps):
        yield f"recover says {said}, and has kept {len(kept.rows)} messages up to step {last}"
    if recovery.holes:
        yield f"there is a hole: {'; '.join(recovery.holes)}"
    # What each process runs on; its faults; that one was replaced, or what lacks.
    noted = {layout.FAULTS_METADATA, layout.INCOMPLETE_METADATA} & kept.metadata.keys()
    names = execution.watch.state.participants
    count = 1 + len(names) + bool(execution.watch.replaced) + len(noted)
    if recovery.attachments != 1 or not count - 1 <= recovery.metadata <= count:
        yield f"recover kept {recovery.attachments} attachments, {recovery.metadata} metadata"
    is_torn = any(fault.kind == "power" for fault in execution.effective)
    has_end = _DATA_END in recovery.source.read_bytes()
    if recovery.only_index_lost != has_end and not (is_torn and has_end):
        yield f"recover says that only the index is lost: {recovery.only_index_lost}"
    missing = 0 if recovery.only_index_lost else max(0, execution.tape.steps - 1 - last)
    if recovery.missing_steps != missing:
        yield f"recover says that {recovery.missing_steps} steps are missing, not {missing}"
    result = execution.result
    if result is not None and result.exit_code == 0:
        lost = recovery.lost_bytes, recovery.cut_step, recovery.missing_steps, recovery.damage
        if lost != (0, None, 0, ""):
            yield f"recover says that a whole recording lacks something: {lost}"


def _ports(truth: Reference) -> set[str]:
    """Return the topics of participants."""
    return truth.by_topic.keys() - {log_reader.CHAIN, log_reader.CALLS}


def _judge_safe_stop(execution: Execution, kept: Sequence[Row]) -> Iterator[str]:
    """Yield where a run did not come to its safe stop although only one participant was struck."""
    replaced, (first, until) = execution.watch.replaced, execution.watch.held
    own = {replaced, f"{replaced}>{ORCHESTRATOR}"}
    # One that has published nothing leaves nothing to hold, and what it has lost stays lost.
    if not replaced or first == 0:
        return
    if any(one.target not in own or one.kind in UNSEEN for one in execution.effective):
        return
    # Where only the link to the orchestrator is slow, readers may have what it has never seen.
    if execution.result is not None and "twice with different" in execution.result.reason:
        return
    for topic in _ports(reference(execution.tape.scenario, execution.tape.steps)):
        newest = max((row.step for row in kept if row.topic == topic), default=-1)
        every = execution.every(topic.partition("/")[0])
        if newest < until - every:
            yield f"{replaced} was replaced up to step {until}; {topic} ends at step {newest}"


def _judge_follow_up(execution: Execution, kept: Sequence[Row]) -> Iterator[str]:
    """Rerun, branch or replay the recording as its tape says; yield each problem."""
    tape = execution.tape
    truth = reference(tape.scenario, tape.steps)
    # Of each port all that is recorded is there, up to its last message; see above.
    lasts = {row.topic: row.step for row in kept if row.topic != log_reader.CHAIN}
    complete = min(lasts.get(topic, -1) for topic in _ports(truth))
    if complete < 2:
        return
    follow_up = FollowUp(execution, complete)
    follow_up.run()
    if follow_up.crash or follow_up.late or follow_up.problem:
        yield f"{tape.then}: {follow_up.crash or follow_up.late or follow_up.problem}"
        return
    if follow_up.new is None:
        return
    # A call that was not made is not repeated.
    made = sum(row.topic == log_reader.CALLS for row in kept)
    calls = [row.step for row in truth.by_topic.get(log_reader.CALLS, ())]
    end = calls[made] if made < len(calls) else tape.steps + 1
    if [row for row in log_reader.read(follow_up.new).rows if row.step < end] != [
        row for row in truth.rows if row.step < end
    ]:
        yield f"{tape.then}: what it has recorded is not the reference"


def _judge_crash(execution: Execution) -> Iterator[str]:
    """Yield what is wrong after an orchestrator was killed."""
    path, watch = execution.out / "run.mcap", execution.watch
    if not path.exists():
        return
    try:
        recovery, log = _recovered(path)
    except StepbusError as exc:
        if "nothing to recover" not in str(exc) or watch.written:
            yield f"cannot be recovered: {exc}"
        return
    yield from _judge_recovery(execution, recovery, log)
    yield from judge_messages(execution, log)
    newest = log.last_step
    if all(fault.kind in CRASHES for fault in execution.effective):
        truth = reference(execution.tape.scenario, execution.tape.steps).rows
        own, whole = (
            [row for row in rows if row.step == newest and row.topic != log_reader.CHAIN]
            for rows in (log.rows, truth)
        )
        if own != whole:
            yield f"step {newest} was saved in part: {', '.join(row.topic for row in own)}"
    # A write that is torn can take with it all that it replaces, up to a chunk.
    excused = ("power", "sleep", "suspend")
    killed_ns = execution.orchestrator.ended_ns
    due = [step for at_ns, step in watch.written if at_ns < killed_ns - _LOSS_NS]
    is_excused = on_disk(execution) or any(f.kind in excused for f in execution.effective)
    if not is_excused and newest < max(due, default=0) - 1:
        yield f"step {newest} is the last that was saved; {max(due)} was complete 0.3 s before"
