"""Checks of the inputs: which message is due, held, absent or late."""

from __future__ import annotations

from collections.abc import Mapping

from stepbus_orchestrator.conformance.check import Check
from stepbus_orchestrator.conformance.harness.feeds import Feed, repeated, shifted
from stepbus_orchestrator.conformance.harness.harness import Harness
from stepbus_orchestrator.conformance.harness.kit import Kit, Trace, step_problem
from stepbus_orchestrator.conformance.harness.setup import Setup
from stepbus_orchestrator.conformance.outcome import Failed, Skipped

_SLOW_S = 0.1


def late_input(kit: Kit) -> str:
    """Hold back the inputs of one step until it says that it waits for them."""
    kit.need_inputs()
    reference, held = kit.reference(), kit.middle
    needed = {i.source for i in kit.spec.inputs.values() if i.delay == 0}
    if not needed:
        raise Skipped("all of its inputs are delayed")

    def play(harness: Harness) -> None:
        harness.walk(kit.material.feed, 0, held)
        harness.release(held + 1)
        _await_waiting(kit, harness, held, needed)
        harness.feed(kit.material.feed, held)
        harness.await_output(held)
        harness.walk(kit.material.feed, held + 1, kit.steps)

    kit.same(kit.play(play=play), "with late inputs", reference)
    return f"waited at step {held}, named its source, then the same outputs"


def _await_waiting(kit: Kit, harness: Harness, step: int, sources: set[str]) -> None:
    """Wait until it says that it waits for a source; meanwhile it may not be further."""
    transcript = harness.transcript
    # One that publishes first has done so before it waits.
    allowed = step if kit.spec.publishes == "first" else step - 1
    harness.until(
        lambda: (
            transcript.newest > allowed
            or any(transcript.waits(step, {name}) for name in sources)
            or transcript.waits(step, sources)
        ),
        f"a Log with waiting step {step} and a source of {sorted(sources)}",
        kit.spec.deadlines.step_s,
        harness.repeat,
    )
    if transcript.newest > allowed:
        raise Failed(f"it published step {transcript.newest} without the inputs of step {step}")


def slow_peer(kit: Kit) -> str:
    """Let one source after the other be slow, at each of some steps."""
    kit.need_inputs()
    reference, sources = kit.reference(), list(kit.material.feed)

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.release(step + 1)
            slow = sources[step % len(sources)] if step in {2, 3, kit.middle} else ""
            harness.feed({k: v for k, v in kit.material.feed.items() if k != slow}, step)
            if slow:
                harness.idle(_SLOW_S)
                harness.feed({slow: kit.material.feed[slow]}, step)
            harness.await_output(step)

    kit.same(kit.play(play=play), "with a slow peer", reference)
    return "the same outputs"


def inputs_ahead(kit: Kit) -> str:
    """Let the peers publish everything before the first trigger."""
    kit.need_inputs()

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.feed(kit.material.feed, step)
        for step in range(kit.steps):
            harness.release(step + 1)
            harness.await_output(step)

    kit.same(kit.play(play=play), "with peers far ahead")
    return f"peers {kit.steps} steps ahead: the same outputs"


def absent(kit: Kit) -> str:
    """Leave out one input after the other for the first steps."""
    kit.need_inputs()
    kit.reference()
    found = [f"{name}: {_without(kit, name)}" for name in kit.spec.inputs]
    return "; ".join(found)


def _without(kit: Kit, name: str) -> str:
    item = kit.spec.inputs[name]
    feed = _from_step(kit.material.feed, item.source, item.port, kit.middle)
    with kit.harness() as harness:
        harness.meet()
        harness.start()
        try:
            harness.walk(feed, 0, kit.steps)
        except Failed as exc:
            if not harness.transcript.faults:
                raise Failed(f"without {name} at first: {exc}; no Fault came (P10.1)") from exc
            return f"a fault ({harness.transcript.faults[0].message[:80]})"
    return "continues"


def _from_step(feed: Feed, source: str, port: str, first: int) -> Feed:
    rows = {
        step: {p: data for p, data in row.items() if p != port or step >= first}
        for step, row in feed[source].items()
    }
    return {**feed, source: rows}


def delayed(kit: Kit) -> str:
    """Delay one input after the other by a step: the same as its source a step later."""
    kit.need_inputs()
    kit.reference()
    found = []
    for name, item in kit.spec.inputs.items():
        every = kit.material.scenario.participant(item.source).every
        more = item.delay + every
        ports = {(item.source, item.port)}
        if any(n != name and (i.source, i.port) in ports for n, i in kit.spec.inputs.items()):
            continue
        expected = _or_fault(kit, shifted(kit.material.feed, ports, every), Setup())
        given = _or_fault(kit, kit.material.feed, Setup(delays={name: more}))
        if isinstance(expected, str) or isinstance(given, str):
            _same_fault(name, expected, given)
            found.append(f"{name}: cannot be absent")
        else:
            kit.same(given, f"with {name} delayed by {more} steps", expected)
            found.append(f"{name} by {more}: right")
    if all(text.endswith("absent") for text in found):
        raise Skipped(f"a delayed input is absent at first, and {'; '.join(found)}")
    return "; ".join(found)


def _or_fault(kit: Kit, feed: Feed, setup: Setup) -> Trace | str:
    """Return a run, or the message of the fault that ends it."""
    with kit.harness(setup) as harness:
        harness.meet()
        harness.start()
        try:
            harness.walk(feed, 0, kit.steps)
        except Failed:
            if not harness.transcript.faults:
                raise
            return harness.transcript.faults[0].message
        return Trace.of(harness.transcript)


def _same_fault(name: str, expected: Trace | str, given: Trace | str) -> None:
    if isinstance(expected, str) and isinstance(given, str):
        return
    where = "delayed" if isinstance(given, str) else "left out at first"
    text = given if isinstance(given, str) else expected
    raise Failed(f"only with {name} {where} it reports a fault: {text}")


def rarer_source(kit: Kit) -> str:
    """Let its sources fire at every third step: the same as messages left out in between."""
    kit.need_inputs()
    kit.reference()
    every = {name: 3 * kit.material.scenario.participant(name).every for name in kit.material.feed}
    expected = kit.play(_rare(kit.material.feed, every))
    given = kit.play(setup=Setup(every=every))
    kit.same(given, "with sources that fire at every third step", expected)
    return "the due messages, held in between"


def _rare(feed: Feed, every: Mapping[str, int]) -> Feed:
    return {
        name: {step: row if step % every[name] == 0 else {} for step, row in rows.items()}
        for name, rows in feed.items()
    }


def own_every(kit: Kit) -> str:
    """Let it fire at every other step, with messages at the steps in between only."""
    kit.need_inputs()
    kit.reference()
    often, seldom = kit.spec.every, 2 * kit.spec.every
    setup = Setup(every={kit.spec.name: seldom})
    between, moved = {}, {}
    for name, rows in kit.material.feed.items():
        if kit.material.scenario.participant(name).every != often:
            between[name] = moved[name] = rows
            continue
        between[name] = {s: row if s == 0 or s % seldom else {} for s, row in rows.items()}
        moved[name] = {
            s: rows[max(0, s - often)] if s % seldom == 0 else {} for s, row in rows.items()
        }
    given = kit.play(between, setup=setup)
    expected = kit.play(moved, setup=setup)
    problem = step_problem(given.transcript)
    if problem:
        raise Failed(problem)
    kit.same(given, "with messages at the steps in between", expected)
    return f"fires at multiples of {seldom}, and has what came in between"


def held(kit: Kit) -> str:
    """Leave out all messages at every other step: each input holds the one before."""
    kit.need_inputs()
    kit.reference()
    pairs = {name: 2 * kit.material.scenario.participant(name).every for name in kit.material.feed}
    thin = _rare(kit.material.feed, pairs)
    given = kit.play(thin)
    expected = kit.play(repeated(thin))
    if given.ports == expected.ports:
        return "the same outputs as with repeated messages"
    if kit.varies():
        raise Skipped("its outputs differ from run to run anyway; see `determinism`")
    _depends_on_held(kit, thin, given)
    return "holds; a held message is not the same to it as one that is repeated"


def _depends_on_held(kit: Kit, thin: Feed, given: Trace) -> None:
    """Raise Failed where the message that is held has no effect on the outputs of later steps.

    One that differentiates its input may distinguish a held message from a repeated one. But then
    another message to hold gives other outputs, also while it is held.
    """
    at = next(s for s in range(kit.middle, kit.steps) if all(rows.get(s) for rows in thin.values()))
    other = {name: {**rows, at: rows[0]} for name, rows in thin.items()}
    changed = kit.play(other)
    after = at + kit.spec.every * (2 if kit.spec.publishes == "first" else 1)
    if after < kit.steps and given.ports[after] == changed.ports[after] and given.ports[after]:
        raise Failed(
            f"its outputs of step {after} do not depend on the messages of step {at}, which hold "
            "there; and they differ from those with the messages repeated"
        )


CHECKS = (
    Check(
        name="late-input",
        clause="P6.2",
        summary="it waits for late inputs, reports the source, and publishes the same",
        run=late_input,
    ),
    Check(
        name="slow-peer",
        clause="P6.2",
        summary="peers that are slow at times change nothing",
        run=slow_peer,
    ),
    Check(
        name="inputs-ahead",
        clause="P6.2",
        summary="peers far ahead change nothing: it uses the due message, not the newest",
        run=inputs_ahead,
    ),
    Check(
        name="absent",
        clause="P6.3",
        summary="while an input is absent, it continues or reports a fault",
        run=absent,
    ),
    Check(
        name="delayed",
        clause="P6.1",
        summary="an input with more `delay` gets the older message",
        run=delayed,
    ),
    Check(
        name="rarer-source",
        clause="P6.1",
        summary="from a source that fires less often, it uses the due message",
        run=rarer_source,
    ),
    Check(
        name="own-every",
        clause="P6.3",
        summary="firing at every other step, it still gets the messages in between",
        run=own_every,
    ),
    Check(
        name="held",
        clause="P6.3",
        summary="it holds an input when the source leaves out the port",
        run=held,
    ),
)
