"""Limits as `ulimit` sets them."""

from __future__ import annotations

import random
import resource
from collections.abc import Callable

from campaign.sandbox import Sandbox


def few_files(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Limit each process to few open files (ulimit -n)."""
    number = chance.choice((chance.randrange(5, 16), chance.randrange(16, 80)))
    return limit(resource.RLIMIT_NOFILE, number)


def small_files(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Limit each process to small files (ulimit -f)."""
    return limit(resource.RLIMIT_FSIZE, 1024 * chance.randrange(1, 2000))


def little_memory(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Give each process little address space (ulimit -v)."""
    return limit(resource.RLIMIT_AS, chance.randrange(60, 2000) << 20)


def little_time(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    """Give each process little processor time (ulimit -t)."""
    return limit(resource.RLIMIT_CPU, chance.randrange(1, 4))


def limit(what: int, number: int) -> Callable[[], None]:
    """Return what sets a limit of the process that calls it."""
    return lambda: resource.setrlimit(what, (number, number))
