"""Where the tests find the checkout and what lies in it."""

from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
TESTS = CHECKOUT / "tests"
PROGRAMS = TESTS / "support/programs"
DOCS = CHECKOUT / "docs"
GOLDEN_LOGS = sorted(
    [*TESTS.glob("scenarios/golden/*.mcap"), *CHECKOUT.glob("*/tests/golden/*.mcap")]
)
"""Golden logs of stepbus and of the packages beside it, which need not be installed to read them."""
