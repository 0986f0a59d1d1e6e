"""Finds the shortest tape that still fails: fewer faults, plain knobs, earlier, shorter."""

from collections.abc import Callable, Iterator

import msgspec

from .tape import Fault, Knobs, Tape

_replace = msgspec.structs.replace


def shrink(tape: Tape, fails: Callable[[Tape], bool], most: int = 300) -> Tape:
    """Return the smallest tape found that fails, in so many trials at most."""
    trials = 0
    smaller = True
    while smaller:
        smaller = False
        for candidate in _smaller(tape):
            trials += 1
            if trials > most:
                return tape
            if fails(candidate):
                tape, smaller = candidate, True
                break
    return tape


def _smaller(tape: Tape) -> Iterator[Tape]:
    """Yield tapes that are a little simpler, the boldest first."""
    faults = tape.faults
    for number in range(len(faults)):
        yield _replace(tape, faults=faults[:number] + faults[number + 1 :])
    if tape.scenario != "loop" and not any("camera" in fault.target for fault in faults):
        yield _replace(tape, scenario="loop")
    defaults = Knobs()
    for name in Knobs.__struct_fields__:
        value = getattr(defaults, name)
        if getattr(tape.knobs, name) != value:
            yield _replace(tape, knobs=_replace(tape.knobs, **{name: value}))
    for steps in (10, 20, 50):
        if steps < tape.steps:
            yield _replace(tape, steps=steps)
    for number, fault in enumerate(faults):
        for simpler in _simpler(fault):
            yield _replace(tape, faults=(*faults[:number], simpler, *faults[number + 1 :]))


def _simpler(fault: Fault) -> Iterator[Fault]:
    for at in sorted({0, fault.at // 2, _round(fault.at)}):
        if at < fault.at:
            yield _replace(fault, at=at)
    amount = _round(fault.amount)
    if fault.amount > 1000 and amount < fault.amount:
        yield _replace(fault, amount=amount)


def _round(value: int) -> int:
    """Return a number with one digit that is not 0."""
    digits: int = 10 ** max(0, len(str(abs(value))) - 1)
    return (value // digits) * digits
