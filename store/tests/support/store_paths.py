"""Where the tests of the store find what lies beside them."""

from pathlib import Path

import stepbus_store

STORE_TESTS = Path(__file__).parents[1]
STORE_DOCS = STORE_TESTS.parent / "docs"
STORE_PROGRAMS = STORE_TESTS / "support/programs"
STORE_GOLDEN = STORE_TESTS / "golden"
SCENARIOS = Path(stepbus_store.__file__).parent / "scenarios"
