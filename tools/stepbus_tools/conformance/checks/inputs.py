"""Checks of the inputs: which message is due, held, absent or late."""

from collections.abc import Mapping

from stepbus_tools.conformance.check import check
from stepbus_tools.conformance.feeds import Feed, repeated, shifted
from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Kit, Trace
from stepbus_tools.conformance.material import Setup
from stepbus_tools.conformance.outcome import Failed, Skipped

_SLOW_S = 0.1
_BATCH = 4


@check("P6.2", "it waits for late inputs, reports the source, and publishes the same", inputs=True)
def late_input(kit: Kit) -> str:
    """Hold back the inputs of one step until it says that it waits for them."""
    kit.reference()
    held = kit.middle
    needed = {i.source for i in kit.spec.inputs.values() if i.delay == 0}
    if not needed:
        raise Skipped("all of its inputs are delayed")

    def play(harness: Harness) -> None:
        harness.walk(kit.feed, 0, held)
        harness.release(held + 1)
        _await_waiting(kit, harness, held, needed)
        harness.feed(kit.feed, held)
        harness.await_output(held)
        harness.walk(kit.feed, held + 1, kit.steps)

    kit.unchanged("with late inputs", play=play)
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


@check("P6.2", "peers that are slow at times change nothing", inputs=True)
def slow_peer(kit: Kit) -> str:
    """Let one source after the other be slow, at each of some steps."""
    sources = list(kit.feed)

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.release(step + 1)
            slow = sources[step % len(sources)] if step in {2, 3, kit.middle} else ""
            harness.feed({k: v for k, v in kit.feed.items() if k != slow}, step)
            if slow:
                harness.idle(_SLOW_S)
                harness.feed({slow: kit.feed[slow]}, step)
            harness.await_output(step)

    kit.unchanged("with a slow peer", play=play)
    return "the same outputs"


@check(
    "P6.2", "peers far ahead change nothing: it uses the due message, not the newest", inputs=True
)
def inputs_ahead(kit: Kit) -> str:
    """Let the peers publish everything before the first trigger."""

    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.feed(kit.feed, step)
        harness.walk({}, 0, kit.steps)

    kit.unchanged("with peers far ahead", play=play)
    return f"peers {kit.steps} steps ahead: the same outputs"


@check("P7.6", "inputs of several steps in one message change nothing", inputs=True, plain=True)
def batches(kit: Kit) -> str:
    """Publish the outputs of each source in batches, where it says that it takes them."""
    hello = kit.reference().transcript.hello
    if hello is None or not hello.batches:
        raise Skipped("its Hello does not say `batches`; it gets each step by itself")
    specs = kit.material.scenario.participants
    bulk = {spec.name for spec in specs if any(o.bulk for o in spec.outputs.values())}
    alone = {name: rows for name, rows in kit.feed.items() if name in bulk}
    if len(alone) == len(kit.feed):
        raise Skipped("all of its sources have bulk ports, and publish each step by itself")

    def play(harness: Harness) -> None:
        for source, rows in kit.feed.items():
            if source in alone:
                continue
            steps = [step for step in rows if step % kit.every(source) == 0]
            for at in range(0, len(steps), _BATCH):
                harness.publish_batch(source, {k: rows[k] for k in steps[at : at + _BATCH]})
        harness.walk(alone, 0, kit.steps)

    kit.unchanged("with inputs in batches", play=play)
    return f"{_BATCH} steps in one message: the same outputs"


@check("P6.3", "while an input is absent, it continues or reports a fault", inputs=True, plain=True)
def absent(kit: Kit) -> str:
    """Leave out one input after the other for the first steps."""
    return "; ".join(f"{name}: {_without(kit, name)}" for name in kit.spec.inputs)


def _without(kit: Kit, name: str) -> str:
    item = kit.spec.inputs[name]
    rows = {
        step: {p: data for p, data in row.items() if p != item.port or step >= kit.middle}
        for step, row in kit.feed[item.source].items()
    }
    try:
        outcome = _or_fault(kit, {**kit.feed, item.source: rows})
    except Failed as exc:
        raise Failed(f"without {name} at first: {exc}; no Fault came (P10.1)") from exc
    return f"a fault ({outcome[:80]})" if isinstance(outcome, str) else "continues"


def _or_fault(kit: Kit, feed: Feed, setup: Setup | None = None) -> Trace | str:
    """Return a run, or the message of the fault that ends it."""
    with kit.running(setup=setup) as harness:
        try:
            harness.walk(feed, 0, kit.steps)
        except Failed:
            if not harness.transcript.faults:
                raise
            return harness.transcript.faults[0].message
        return Trace.of(harness.transcript)


@check("P6.1", "an input with more `delay` gets the older message", inputs=True, plain=True)
def delayed(kit: Kit) -> str:
    """Delay one input after the other by a step: the same as its source a step later."""
    rows = []
    for name, item in kit.spec.inputs.items():
        more = item.delay + kit.every(item.source)
        port = (item.source, item.port)
        if any(n != name and (i.source, i.port) == port for n, i in kit.spec.inputs.items()):
            continue
        expected = _or_fault(kit, shifted(kit.feed, {port}, kit.every(item.source)))
        given = _or_fault(kit, kit.feed, Setup(delays={name: more}))
        if isinstance(expected, str) or isinstance(given, str):
            _same_fault(name, expected, given)
            rows.append(f"{name}: cannot be absent")
        else:
            kit.same(given, f"with {name} delayed by {more} steps", expected)
            rows.append(f"{name} by {more}: right")
    if all(text.endswith("absent") for text in rows):
        raise Skipped(f"a delayed input is absent at first, and {'; '.join(rows)}")
    return "; ".join(rows)


def _same_fault(name: str, expected: Trace | str, given: Trace | str) -> None:
    if isinstance(expected, str) and isinstance(given, str):
        return
    where = "delayed" if isinstance(given, str) else "left out at first"
    text = given if isinstance(given, str) else expected
    raise Failed(f"only with {name} {where} it reports a fault: {text}")


@check("P6.1", "from a source that fires less often, it uses the due message", inputs=True)
def rarer_source(kit: Kit) -> str:
    """Let its sources fire at every third step: the same as messages left out in between."""
    every = {name: 3 * kit.every(name) for name in kit.feed}
    expected = kit.play(_rare(kit.feed, every))
    given = kit.play(setup=Setup(every=every))
    kit.same(given, "with sources that fire at every third step", expected)
    return "the due messages, held in between"


def _rare(feed: Feed, every: Mapping[str, int]) -> Feed:
    return {
        name: {step: row if step % every[name] == 0 else {} for step, row in rows.items()}
        for name, rows in feed.items()
    }


@check("P6.3", "firing at every other step, it still gets the messages in between", inputs=True)
def own_every(kit: Kit) -> str:
    """Let it fire at every other step, with messages at the steps in between only."""
    often, seldom = kit.spec.every, 2 * kit.spec.every
    setup = Setup(every={kit.spec.name: seldom})
    between, moved = dict(kit.feed), dict(kit.feed)
    for name, rows in kit.feed.items():
        if kit.every(name) == often:
            between[name] = {s: row if s == 0 or s % seldom else {} for s, row in rows.items()}
            moved[name] = {
                s: rows[max(0, s - often)] if s % seldom == 0 else {} for s, row in rows.items()
            }
    given = kit.play(between, setup=setup)
    expected = kit.play(moved, setup=setup)
    if given.transcript.step_problem:
        raise Failed(given.transcript.step_problem)
    kit.same(given, "with messages at the steps in between", expected)
    return f"fires at multiples of {seldom}, and has what came in between"


@check("P6.3", "it holds an input when the source leaves out the port", inputs=True)
def held(kit: Kit) -> str:
    """Leave out all messages at every other step: each input holds the one before."""
    thin = _rare(kit.feed, {name: 2 * kit.every(name) for name in kit.feed})
    given = kit.play(thin)
    expected = kit.play(repeated(thin))
    if given.ports == expected.ports:
        return "the same outputs as with repeated messages"
    kit.skip_if_varies()
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
