"""How many examples property tests draw; see `conftest.pytest_configure`."""

from hypothesis import settings

DEFAULT = 100


def examples(count: int) -> int:
    """Return how many examples to draw: ten times as many with `--fresh-examples`."""
    return count * settings.default.max_examples // DEFAULT
