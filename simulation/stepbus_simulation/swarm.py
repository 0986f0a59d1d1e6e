"""Draws tapes: first which kinds of faults take part, then the faults and the knobs."""

from collections.abc import Iterator
from random import Random

from .again import AGAIN
from .draw import Draw
from .kinds import KINDS
from .programs import SCENARIOS
from .tape import ORCHESTRATOR, Fault, Knobs, Tape

_ISOLATION = 0.5
_THEN = [*([""] * 27), *AGAIN]

_NAMES = {name: list(make()) for name, make in SCENARIOS.items()}


def draw_tape(seed: int, number: int) -> Tape:
    """Return a tape; the same one for the same numbers."""
    random = Random(f"{seed}/{number}")
    steps = random.choice([50, 50, 50, 80, 120])
    kinds = random.sample(list(KINDS), random.choice([1, 1, 2, 3, 5]))
    needed = [KINDS[kind].needs for kind in kinds if KINDS[kind].needs]
    name = random.choice(needed or list(SCENARIOS))
    preferred = random.choice(["", random.choice(_NAMES[name])])
    knobs = _knobs(random)
    names = _NAMES[name]
    draw = Draw(random=random, names=names, steps=steps, preferred=preferred, knobs=knobs)
    count = min(1 + int(random.expovariate(0.7)), 8)
    faults = tuple(KINDS[random.choice(kinds)].draw(draw) for _ in range(count))
    if "cut" in kinds and random.random() < _ISOLATION:
        faults = (*faults, *_isolation(draw))
    return Tape(name, steps, knobs, faults, random.choice(_THEN))


def _isolation(draw: Draw) -> Iterator[Fault]:
    """Yield what cuts a process off, and heals its links one by one, in a random order."""
    one, at = draw.name(), draw.time()
    for other in [*draw.names, ORCHESTRATOR]:
        if other != one:
            yield Fault("cut", f"{one}>{other}", at, draw.lasting())


def _knobs(random: Random) -> Knobs:
    defaults = Knobs()
    window = random.choice([1, 2, 3, 8, 64])
    return Knobs(
        window=window,
        batch=random.choice([0, 0, 1]),
        spawn_ms=random.choice([defaults.spawn_ms, 1_000]),
        join_ms=random.choice([defaults.join_ms, 1_000]),
        ready_ms=random.choice([defaults.ready_ms, 1_000]),
        step_ms=random.choice([defaults.step_ms, 300, 1_000]),
        stop_ms=random.choice([defaults.stop_ms, 500]),
        compute_us=random.choice([0, 0, 100, 2_000, 10_000]),
        link_us=random.choice([30, 30, 1, 1_000]),
        buffer_bytes=random.choice([200_000, 20_000, 5_000]),
        chunk_bytes=random.choice([defaults.chunk_bytes, 2_000, 10_000]),
        heal_ms=random.choice([0, 0, 300, 2_000]),
    )
