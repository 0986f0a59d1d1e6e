"""Checks of the inputs: which message is due, held, absent or late."""

from stepbus_tools.conformance.harness import Harness
from stepbus_tools.conformance.kit import Kit, check
from stepbus_tools.conformance.material import Feed, Setup, each_step, repeated, shifted, thinned
from stepbus_tools.conformance.transcript import Failed, Skipped, Transcript

_SLOW_S = 0.1
_BATCH = 4


@check("P6.2", "it waits for late inputs, reports the source, and publishes the same", inputs=True)
def _late_input(kit: Kit) -> str:
    kit.reference()
    held = kit.middle
    needed = {i.source for i in kit.spec.inputs.values() if i.delay == 0}
    if not needed:
        raise Skipped("all of its inputs are delayed")
    # One that publishes first has done so before it waits.
    allowed = held if kit.spec.publishes == "first" else held - 1

    def hold_back(harness: Harness, step: int) -> None:
        transcript = harness.transcript
        if step != held:
            return
        harness.until(
            lambda: (
                transcript.newest > allowed
                or any(transcript.waits(held, {name}) for name in needed)
                or transcript.waits(held, needed)
            ),
            f"a Log with waiting step {held} and a source of {sorted(needed)}",
            tick=harness.repeat,
        )
        if transcript.newest > allowed:
            raise Failed(f"it published step {transcript.newest} without the inputs of step {held}")

    kit.unchanged("with late inputs", before=hold_back)
    return f"waited at step {held}, named its source, then the same outputs"


@check("P6.2", "peers that are temporarily slow change nothing", inputs=True)
def _slow_peer(kit: Kit) -> str:
    sources = list(kit.feed)
    slow = {step: sources[step % len(sources)] for step in (2, 3, kit.middle)}
    quick = {
        source: {step: row for step, row in rows.items() if slow.get(step) != source}
        for source, rows in kit.feed.items()
    }

    def be_slow(harness: Harness, step: int) -> None:
        if step in slow:
            harness.idle(_SLOW_S)
            harness.feed({slow[step]: kit.feed[slow[step]]}, step)

    return kit.unchanged("with a slow peer", quick, after=be_slow)


@check(
    "P6.2",
    "peers far ahead change nothing: it uses the message that is due, not the newest",
    inputs=True,
)
def _inputs_ahead(kit: Kit) -> str:
    def play(harness: Harness) -> None:
        for step in range(kit.steps):
            harness.feed(kit.feed, step)
        harness.walk({}, 0, kit.steps)

    kit.unchanged("with peers far ahead", play=play)
    return f"peers {kit.steps} steps ahead: the same outputs"


@check("P7.6", "inputs of several steps in one message change nothing", inputs=True, plain=True)
def _batches(kit: Kit) -> str:
    hello = kit.reference().hello
    if hello is None or not hello.batches:
        raise Skipped("its Hello does not set `batches`; it gets each step separately")
    specs = kit.material.scenario.participants
    bulk = {spec.name for spec in specs if any(o.bulk for o in spec.outputs.values())}
    alone = {name: rows for name, rows in kit.feed.items() if name in bulk}
    if len(alone) == len(kit.feed):
        raise Skipped("all of its sources have bulk ports and publish each step separately")

    def play(harness: Harness) -> None:
        for source in kit.feed.keys() - alone.keys():
            rows = kit.feed[source]
            steps = [step for step in rows if step % kit.every(source) == 0]
            for at in range(0, len(steps), _BATCH):
                harness.publish_batch(source, {k: rows[k] for k in steps[at : at + _BATCH]})
        harness.walk(alone, 0, kit.steps)

    kit.unchanged("with inputs in batches", play=play)
    return f"{_BATCH} steps in one message: the same outputs"


@check("P6.3", "while an input is absent, it continues or reports a fault", inputs=True, plain=True)
def _absent(kit: Kit) -> str:
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


def _or_fault(kit: Kit, feed: Feed, setup: Setup | None = None) -> Transcript | str:
    """Return a run, or the message of the fault that ends it."""
    with kit.running(setup=setup) as harness:
        fault = harness.fault_during(lambda: harness.walk(feed, 0, kit.steps))
        return harness.transcript if fault is None else fault.message


@check("P6.1", "an input with a larger `delay` gets the older message", inputs=True, plain=True)
def _delayed(kit: Kit) -> str:
    """Delay one input after the other by a step: the same as its source a step later."""
    verdicts: dict[str, str] = {}
    ports = [(item.source, item.port) for item in kit.spec.inputs.values()]
    for name, item in kit.spec.inputs.items():
        port = (item.source, item.port)
        if ports.count(port) > 1:
            continue
        more = item.delay + kit.every(item.source)
        expected = _or_fault(kit, shifted(kit.feed, {port}, kit.every(item.source)))
        given = _or_fault(kit, kit.feed, Setup(delays={name: more}))
        if isinstance(expected, str) and isinstance(given, str):
            verdicts[name] = "cannot be absent"
        elif isinstance(expected, str) or isinstance(given, str):
            where = "delayed" if isinstance(given, str) else "absent at first"
            text = given if isinstance(given, str) else expected
            raise Failed(f"it reports a fault only with {name} {where}: {text}")
        else:
            kit.same(given, f"with {name} delayed by {more} steps", expected)
            verdicts[name] = f"by {more}: right"
    shown = "; ".join(f"{name} {text}" for name, text in verdicts.items())
    if set(verdicts.values()) <= {"cannot be absent"}:
        raise Skipped(f"a delayed input is absent at first, and {shown}")
    return shown


@check("P6.1", "from a source that fires less often, it uses the due message", inputs=True)
def _rarer_source(kit: Kit) -> str:
    """Make its sources fire at every third step: the same as messages left out in between."""
    every = {name: 3 * kit.every(name) for name in kit.feed}
    expected = kit.play(thinned(kit.feed, every))
    given = kit.play(setup=Setup(every=every))
    kit.same(given, "with sources that fire at every third step", expected)
    return "the due messages, held in between"


@check(
    "P6.1",
    "while nothing is due, it waits for no input: rarer sources, each `delay` > 0",
    inputs=True,
)
def _nothing_due(kit: Kit) -> str:
    """Publish nothing to it until it has read its first step, for which nothing is due."""
    setup = Setup(
        every={name: 3 * kit.every(name) for name in kit.feed},
        delays={name: max(1, item.delay) for name, item in kit.spec.inputs.items()},
    )
    # One that publishes first reads after it: its next step shows that it has read.
    step = kit.spec.every if kit.spec.publishes == "first" else 0
    with kit.running(setup=setup) as harness:
        harness.release(step + 1)
        if fault := harness.fault_during(lambda: harness.await_output(step)):
            return f"does not wait: a fault ({fault.message[:80]})"
    return f"published step {step} before its sources"


@check("P6.3", "firing at every other step, it still gets the messages in between", inputs=True)
def _own_every(kit: Kit) -> str:
    """Make it fire at every other step, with messages at the steps in between only."""
    often, seldom = kit.spec.every, 2 * kit.spec.every
    setup = Setup(every={kit.spec.name: seldom})
    as_often = {name for name in kit.feed if kit.every(name) == often}
    between = each_step(
        kit.feed,
        lambda name, s, row: row if s == 0 or s % seldom or name not in as_often else {},
    )
    given = kit.play(between, setup=setup)
    moved = each_step(
        kit.feed,
        lambda name, s, row: (
            row if name not in as_often else {} if s % seldom else kit.feed[name][max(0, s - often)]
        ),
    )
    expected = kit.play(moved, setup=setup)
    if given.step_problem:
        raise Failed(given.step_problem)
    kit.same(given, "with messages at the steps in between", expected)
    return f"fires at multiples of {seldom}, and has what came in between"


@check("P6.3", "it holds an input when the source leaves out the port", inputs=True)
def _held(kit: Kit) -> str:
    """Leave out all messages at every other step: each input holds the one before."""
    thin = thinned(kit.feed, {name: 2 * kit.every(name) for name in kit.feed})
    given = kit.play(thin).ports()
    if given == kit.play(repeated(thin)).ports():
        return "the same outputs as with repeated messages"
    kit.skip_if_varies()
    # One that differentiates its input may distinguish a held message from a repeated one. But then
    # another message to hold gives other outputs, also while it is held.
    at = next(s for s in range(kit.middle, kit.steps) if all(rows.get(s) for rows in thin.values()))
    changed = kit.play({name: {**rows, at: rows[0]} for name, rows in thin.items()}).ports()
    after = at + kit.spec.every * (2 if kit.spec.publishes == "first" else 1)
    if after < kit.steps and given[after] == changed[after] and given[after]:
        raise Failed(
            f"its outputs of step {after} do not depend on the messages of step {at}, which hold "
            "there; and they differ from those with the messages repeated"
        )
    return "holds; it treats a held message differently from a repeated one"
