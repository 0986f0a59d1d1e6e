"""Checks of the steps themselves: outputs, log, triggers, windows, determinism."""

from __future__ import annotations

from pathlib import Path

from stepbus_orchestrator.conformance.check import Check
from stepbus_orchestrator.conformance.harness.harness import Harness
from stepbus_orchestrator.conformance.harness.kit import Kit, step_problem
from stepbus_orchestrator.conformance.harness.setup import Setup
from stepbus_orchestrator.conformance.outcome import Failed, Skipped
from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.replay import ReplayResult, replay
from stepbus_schemas import encoding_of

WINDOWS = (1, 2, 7, 64)
_TYPES = {"out": "Outputs/1", "log": "Log/1", "ready": "Ready/1"}


def steps(kit: Kit) -> str:
    """Do all steps in lockstep."""
    trace = kit.plain()
    problem = step_problem(trace.transcript)
    if problem:
        raise Failed(problem)
    return f"{len(trace.ports)} Outputs, one for each step it fires at"


def content(kit: Kit) -> str:
    """Check what it published in the plain run."""
    trace = kit.reference()
    for clause in ("P3.4", "P7.2", "P7.3"):
        if clause in trace.transcript.problems:
            raise Failed(trace.transcript.problems[clause])
    silent = [port for port in kit.spec.outputs if not any(port in p for p in trace.ports.values())]
    tail = f"; nothing on {', '.join(silent)}" if silent else ""
    return f"all messages are of their port's type{tail}"


def encodings(kit: Kit) -> str:
    """Check the Zenoh encodings of the plain run."""
    transcript = kit.reference().transcript
    for channel, type_name in _TYPES.items():
        wrong = transcript.encodings.get(channel, set()) - {encoding_of(type_name)}
        if wrong:
            raise Failed(f"on {channel}/: {min(wrong)!r}, not {encoding_of(type_name)!r}")
    return "each names its type"


def log(kit: Kit) -> str:
    """Compare log and outputs of the plain run."""
    transcript = kit.reference().transcript
    logged, published = transcript.logged, transcript.packed
    if logged == published:
        return f"{len(logged)} entries in {len(transcript.logs)} logs, byte for byte"
    if "P9.3" in transcript.problems:
        raise Failed(transcript.problems["P9.3"])
    if len(transcript.logged) > len(transcript.packed):
        raise Failed(
            f"{len(transcript.logged)} entries were logged of {len(transcript.packed)} Outputs"
        )
    pairs = zip(transcript.packed, transcript.logged, strict=False)
    place = next(
        (i for i, (one, other) in enumerate(pairs) if one != other), len(transcript.logged)
    )
    raise Failed(f"entry {place} of its log is not the Outputs number {place}, byte for byte")


def batch(kit: Kit) -> str:
    """Let it fill batches, and wait with one that is not full."""
    size = 4
    windows = Setup(window=2 * size * kit.spec.every)

    def play(harness: Harness) -> None:
        harness.follow(kit.material.feed)
        harness.await_logged()

    transcript = kit.play(setup=windows, play=play).transcript
    largest = max((len(item.outputs) for item in transcript.logs), default=0)
    if largest > size:
        raise Failed(f"a Log has {largest} entries, the Welcome allows {size} (batch)")
    return f"at most {largest} entries in a Log, {size} allowed; none stayed behind"


def determinism(kit: Kit) -> str:
    """Do the plain run twice."""
    first = kit.reference()
    second = kit.plain("second plain run")
    for step, ports in first.ports.items():
        for port in (*ports, *second.ports.get(step, {})):
            if ports.get(port) != second.ports.get(step, {}).get(port):
                raise Failed(f"two runs with the same inputs differ: step {step}: {port}")
    return f"two runs over {kit.steps} steps: the same bytes"


def waits_for_trigger(kit: Kit) -> str:
    """Give it the inputs of a step that is not released."""
    held = kit.middle

    def play(harness: Harness) -> None:
        harness.walk(kit.material.feed, 0, held)
        harness.feed(kit.material.feed, held)
        transcript = harness.transcript
        harness.until(
            lambda: transcript.newest >= held or transcript.waits(held, set()),
            f"a Log with waiting step {held} and no sources",
            kit.spec.deadlines.step_s,
        )
        if transcript.newest >= held:
            raise Failed(f"it published step {held} before a Trigger with step_limit > {held}")
        harness.release(held + 1)
        harness.await_output(held)
        harness.walk(kit.material.feed, held + 1, kit.steps)

    kit.same(kit.play(play=play), "after waiting")
    return f"waited for the trigger of step {held}, and reported it"


def triggers(kit: Kit) -> str:
    """Repeat triggers, send old ones late, skip numbers."""

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            if step % 3 == 0:
                harness.release(min(kit.steps, step + 3))
                harness.release(min(kit.steps, step + 3))
            harness.release(step // 2)
            harness.release(0)
            harness.feed(kit.material.feed, step)
            harness.await_output(step, repeating=False)

    kit.same(kit.play(play=play), "with repeated and late triggers")
    return "the same outputs"


def windows(kit: Kit) -> str:
    """Run it with several windows, as the orchestrator does."""
    kit.reference()
    for window in WINDOWS:
        trace = kit.play(
            setup=Setup(window=window), play=lambda harness: harness.follow(kit.material.feed)
        )
        kit.same(trace, f"with window {window}")
    return f"{', '.join(map(str, WINDOWS))}: the same outputs"


def replayed(kit: Kit) -> str:
    """Record it under the real orchestrator, then replay that recording."""
    folder = kit.log_folder()
    new = folder / "new.mcap"
    try:
        _replay(kit, kit.material.recording, new)
        result = _replay(kit, new, None)
    except RunFailure as exc:
        raise Failed(f"under the orchestrator: {exc}") from exc
    finally:
        new.unlink(missing_ok=True)
    if not result.equal and kit.varies():
        raise Skipped("its outputs differ from run to run anyway; see `determinism`")
    if not result.equal and result.divergence is not None:
        raise Failed(result.divergence.text("recording", "replay"))
    return f"equal to its own recording over {result.steps} steps"


def _replay(kit: Kit, recording: Path, update: Path | None) -> ReplayResult:
    return replay(
        recording,
        kit.spec.name,
        program=None if kit.is_scenarios else kit.command,
        update=update,
        interrupt=kit.interrupt,
    )


CHECKS = (
    Check(
        name="steps",
        clause="P7.1",
        summary="one `Outputs` for each step it fires at, in order, with the right time and token",
        run=steps,
    ),
    Check(
        name="content",
        clause="P7.2",
        summary="its messages are on ports of the scenario and of their types",
        run=content,
    ),
    Check(
        name="encodings",
        clause="P3.2",
        summary="the Zenoh encoding of each of its messages names the type",
        run=encodings,
    ),
    Check(
        name="log",
        clause="P9.1",
        summary="its log has each of its `Outputs` once, in order, byte for byte",
        run=log,
    ),
    Check(
        name="batch",
        clause="P9.2",
        summary="no `Log` has more entries than `batch`, and none is withheld",
        run=batch,
    ),
    Check(
        name="determinism",
        clause="P5.4",
        summary="the same inputs give the same bytes",
        run=determinism,
    ),
    Check(
        name="waits-for-trigger",
        clause="P5.1",
        summary="it starts no step before its trigger, and reports that it waits",
        run=waits_for_trigger,
    ),
    Check(
        name="triggers",
        clause="P5.2",
        summary="repeated and late triggers, and skipped numbers, change nothing",
        run=triggers,
    ),
    Check(
        name="windows",
        clause="P5.4",
        summary="windows of 1, 2, 7 and 64 steps change nothing",
        run=windows,
    ),
    Check(
        name="replayed-log",
        clause="P13.1",
        summary="it runs under the real orchestrator, and equals its own recording",
        run=replayed,
    ),
)
