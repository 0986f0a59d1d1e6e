"""Checks of the steps themselves: outputs, log, triggers, windows, determinism."""

from pathlib import Path

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.replay import ReplayResult, replay
from stepbus_schemas import encoding_of
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Kit, check
from stepbus_tools.conformance.material import Setup
from stepbus_tools.conformance.transcript import Failed

_WINDOWS = (1, 2, 7, 64)
_BATCH = 4


@check("P7.1", "one `Outputs` for each step it fires at, in order, with the right time and token")
def _steps(kit: Kit) -> str:
    transcript = kit.plain()
    if transcript.step_problem:
        raise Failed(transcript.step_problem)
    return f"{len(transcript.outputs)} Outputs, one for each step it fires at"


@check("P7.2", "its messages are on ports of the scenario and have the right types")
def _content(kit: Kit) -> str:
    transcript = kit.reference()
    if problem := transcript.problem("P3.4", "P7.2", "P7.3", "P7.5"):
        raise Failed(problem)
    rows = transcript.ports().values()
    silent = [port for port in kit.spec.outputs if not any(port in row for row in rows)]
    tail = f"; no messages on {', '.join(silent)}" if silent else ""
    return f"all messages are of their port's type{tail}"


@check("P3.2", "the Zenoh encoding of each of its messages names the type")
def _encodings(kit: Kit) -> str:
    bulk = {f"bulk/{port}": output.type for port, output in kit.spec.outputs.items()}
    channels = {"out": "Outputs/1", "log": "Log/1", "ready": "Ready/1", **bulk}
    encodings = kit.reference().encodings
    for channel, type_name in channels.items():
        if wrong := encodings.get(channel, set()) - {encoding_of(type_name)}:
            raise Failed(f"on {channel}: {min(wrong)!r}, not {encoding_of(type_name)!r}")
    return "each names its type"


@check("P3.3", "two independent codecs decode each of its messages to the same content")
def _codecs(kit: Kit) -> str:
    if problem := kit.reference().problem("P3.3"):
        raise Failed(problem)
    return "msgpack and msgspec agree"


@check("P9.1", "its log has each of its `Outputs` once, in order, byte for byte")
def _log(kit: Kit) -> str:
    transcript = kit.reference()
    logged, published = transcript.logged, transcript.packed
    if logged == published:
        return f"{len(logged)} entries in {len(transcript.logs)} logs, byte for byte"
    if problem := transcript.problem("P9.3"):
        raise Failed(problem)
    if len(logged) > len(published):
        raise Failed(f"{len(logged)} of {len(published)} Outputs were logged")
    pairs = enumerate(zip(published, logged, strict=False))
    at = next((i for i, (one, other) in pairs if one != other), len(logged))
    raise Failed(f"entry {at} of its log differs from Outputs {at}")


@check("P9.2", "no `Log` has more entries than `batch`, and none is withheld")
def _batch(kit: Kit) -> str:
    def play(harness: Harness) -> None:
        harness.follow(kit.feed)
        harness.await_logged()

    transcript = kit.play(setup=Setup(window=2 * _BATCH * kit.spec.every), play=play)
    largest = max((len(item.outputs) for item in transcript.logs), default=0)
    if largest > _BATCH:
        raise Failed(f"a Log has {largest} entries, the Welcome allows {_BATCH} (batch)")
    return f"at most {largest} entries in a Log, {_BATCH} allowed; none missing"


@check("P5.4", "the same inputs give the same bytes")
def _determinism(kit: Kit) -> str:
    first, second = kit.reference().ports(), kit.plain("second plain run").ports()
    for step, ports in first.items():
        other = second.get(step, {})
        for port in {**ports, **other}:
            if ports.get(port) != other.get(port):
                raise Failed(f"two runs with the same inputs differ: step {step}: {port}")
    return f"two runs over {kit.steps} steps: the same bytes"


@check("P5.1", "it starts no step before its trigger, and reports that it is waiting")
def _waits_for_trigger(kit: Kit) -> str:
    held = kit.middle

    def play(harness: Harness) -> None:
        harness.walk(kit.feed, 0, held)
        # Its inputs are there.
        harness.feed(kit.feed, held)
        transcript = harness.transcript
        harness.until(
            lambda: transcript.newest >= held or transcript.waits(held, set()),
            f"a Log with waiting step {held} and no sources",
        )
        if transcript.newest >= held:
            raise Failed(f"it published step {held} before a Trigger with step_limit > {held}")
        harness.release(held + 1)
        harness.await_output(held)
        harness.walk(kit.feed, held + 1, kit.steps)

    kit.unchanged("after waiting", play=play)
    return f"waited for the trigger of step {held}, and reported it"


@check("P5.2", "repeated and late triggers, and skipped numbers, change nothing")
def _triggers(kit: Kit) -> str:
    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            if step % 3 == 0:
                harness.release(min(kit.steps, step + 3))
                harness.release(min(kit.steps, step + 3))
            harness.release(step // 2)
            harness.release(0)
            harness.feed(kit.feed, step)
            harness.await_output(step, repeating=False)

    return kit.unchanged("with repeated and late triggers", play=play)


@check("P5.4", "windows of 1, 2, 7 and 64 steps change nothing")
def _windows(kit: Kit) -> str:
    for window in _WINDOWS:
        setup = Setup(window=window)
        kit.unchanged(f"with window {window}", setup=setup, play=lambda h: h.follow(kit.feed))
    return f"{', '.join(map(str, _WINDOWS))}: the same outputs"


@check("P13.1", "it runs under the real orchestrator and reproduces its own recording")
def _replayed_log(kit: Kit) -> str:
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
    return f"equal to its recording over {result.steps} steps"


def _replay(kit: Kit, recording: Path, update: Path | None) -> ReplayResult:
    return replay(
        recording,
        kit.spec.name,
        program=None if kit.is_scenarios else kit.command,
        update=update,
        interrupt=kit.interrupt,
    )
