"""Checks of the steps themselves: outputs, log, triggers, windows, determinism."""

from pathlib import Path

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.replay import ReplayResult, replay
from stepbus_schemas import encoding_of
from stepbus_tools.conformance.check import check
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Kit
from stepbus_tools.conformance.material import Setup
from stepbus_tools.conformance.outcome import Failed

WINDOWS = (1, 2, 7, 64)
_TYPES = {"out": "Outputs/1", "log": "Log/1", "ready": "Ready/1"}


@check("P7.1", "one `Outputs` for each step it fires at, in order, with the right time and token")
def steps(kit: Kit) -> str:
    """Do all steps in lockstep."""
    trace = kit.plain()
    if trace.transcript.step_problem:
        raise Failed(trace.transcript.step_problem)
    return f"{len(trace.ports)} Outputs, one for each step it fires at"


@check("P7.2", "its messages are on ports of the scenario and of their types")
def content(kit: Kit) -> str:
    """Check what it published in the plain run."""
    trace = kit.reference()
    for clause in ("P3.4", "P7.2", "P7.3", "P7.5"):
        if clause in trace.transcript.problems:
            raise Failed(trace.transcript.problems[clause])
    silent = [port for port in kit.spec.outputs if not any(port in p for p in trace.ports.values())]
    tail = f"; nothing on {', '.join(silent)}" if silent else ""
    return f"all messages are of their port's type{tail}"


@check("P3.2", "the Zenoh encoding of each of its messages names the type")
def encodings(kit: Kit) -> str:
    """Check the Zenoh encodings of the plain run."""
    transcript = kit.reference().transcript
    for channel, type_name in _TYPES.items():
        wrong = transcript.encodings.get(channel, set()) - {encoding_of(type_name)}
        if wrong:
            raise Failed(f"on {channel}/: {min(wrong)!r}, not {encoding_of(type_name)!r}")
    for port, output in kit.spec.outputs.items():
        wrong = transcript.encodings.get(f"bulk/{port}", set()) - {encoding_of(output.type)}
        if wrong:
            raise Failed(f"on bulk/…/{port}: {min(wrong)!r}, not {encoding_of(output.type)!r}")
    return "each names its type"


@check("P3.3", "two independent codecs read the same in each of its messages")
def codecs(kit: Kit) -> str:
    """Decode what it sent in the plain run with msgpack too."""
    transcript = kit.reference().transcript
    if "P3.3" in transcript.problems:
        raise Failed(transcript.problems["P3.3"])
    return "msgpack and msgspec read the same"


@check("P9.1", "its log has each of its `Outputs` once, in order, byte for byte")
def log(kit: Kit) -> str:
    """Compare log and outputs of the plain run."""
    transcript = kit.reference().transcript
    logged, published = transcript.logged, transcript.packed
    if logged == published:
        return f"{len(logged)} entries in {len(transcript.logs)} logs, byte for byte"
    if "P9.3" in transcript.problems:
        raise Failed(transcript.problems["P9.3"])
    if len(logged) > len(published):
        raise Failed(f"{len(logged)} entries were logged of {len(published)} Outputs")
    pairs = enumerate(zip(published, logged, strict=False))
    at = next((i for i, (one, other) in pairs if one != other), len(logged))
    raise Failed(f"entry {at} of its log is not the Outputs number {at}, byte for byte")


@check("P9.2", "no `Log` has more entries than `batch`, and none is withheld")
def batch(kit: Kit) -> str:
    """Let it fill batches, and wait with one that is not full."""
    size = 4

    def play(harness: Harness) -> None:
        harness.follow(kit.feed)
        harness.await_logged()

    transcript = kit.play(setup=Setup(window=2 * size * kit.spec.every), play=play).transcript
    largest = max((len(item.outputs) for item in transcript.logs), default=0)
    if largest > size:
        raise Failed(f"a Log has {largest} entries, the Welcome allows {size} (batch)")
    return f"at most {largest} entries in a Log, {size} allowed; none stayed behind"


@check("P5.4", "the same inputs give the same bytes")
def determinism(kit: Kit) -> str:
    """Do the plain run twice."""
    first = kit.reference()
    second = kit.plain("second plain run")
    for step, ports in first.ports.items():
        for port in (*ports, *second.ports.get(step, {})):
            if ports.get(port) != second.ports.get(step, {}).get(port):
                raise Failed(f"two runs with the same inputs differ: step {step}: {port}")
    return f"two runs over {kit.steps} steps: the same bytes"


@check("P5.1", "it starts no step before its trigger, and reports that it waits")
def waits_for_trigger(kit: Kit) -> str:
    """Give it the inputs of a step that is not released."""
    held = kit.middle

    def play(harness: Harness) -> None:
        harness.walk(kit.feed, 0, held)
        harness.feed(kit.feed, held)
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
        harness.walk(kit.feed, held + 1, kit.steps)

    kit.unchanged("after waiting", play=play)
    return f"waited for the trigger of step {held}, and reported it"


@check("P5.2", "repeated and late triggers, and skipped numbers, change nothing")
def triggers(kit: Kit) -> str:
    """Repeat triggers, send old ones late, skip numbers."""

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            if step % 3 == 0:
                harness.release(min(kit.steps, step + 3))
                harness.release(min(kit.steps, step + 3))
            harness.release(step // 2)
            harness.release(0)
            harness.feed(kit.feed, step)
            harness.await_output(step, repeating=False)

    kit.unchanged("with repeated and late triggers", play=play)
    return "the same outputs"


@check("P5.4", "windows of 1, 2, 7 and 64 steps change nothing")
def windows(kit: Kit) -> str:
    """Run it with several windows, as the orchestrator does."""
    for window in WINDOWS:
        setup = Setup(window=window)
        kit.unchanged(f"with window {window}", setup=setup, play=lambda h: h.follow(kit.feed))
    return f"{', '.join(map(str, WINDOWS))}: the same outputs"


@check("P13.1", "it runs under the real orchestrator, and equals its own recording")
def replayed_log(kit: Kit) -> str:
    """Record it under the real orchestrator, then replay that recording."""
    new = kit.log_folder() / "new.mcap"
    try:
        _replay(kit, kit.material.recording, new)
        result = _replay(kit, new, None)
    except RunFailure as exc:
        raise Failed(f"under the orchestrator: {exc}") from exc
    finally:
        new.unlink(missing_ok=True)
    if result.divergence is not None:
        kit.differ(result.divergence.text("recording", "replay"))
    return f"equal to its own recording over {result.steps} steps"


def _replay(kit: Kit, recording: Path, update: Path | None) -> ReplayResult:
    return replay(
        recording,
        kit.spec.name,
        program=None if kit.is_scenarios else kit.command,
        update=update,
        interrupt=kit.interrupt,
    )
