"""Where the tests find the checkout and what lies in it."""

from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
TESTS = CHECKOUT / "tests"
PROGRAMS = TESTS / "support/programs"
DOCS = CHECKOUT / "docs"
