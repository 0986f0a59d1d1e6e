"""Each wait of ours has a time-out, or says what bounds it."""

import ast
import re

import pytest
from support.paths import CHECKOUT

PARTS = (
    "api",
    "orchestrator",
    "participant",
    "schemas",
    "services",
    "store/stepbus_store",
    "tools",
)
SOURCES = [path for part in PARTS for path in sorted((CHECKOUT / part).rglob("*.py"))]
WAITS = r"\.(acquire|communicate|get|join|wait|wait_for)$|^subprocess\.(run|call|check)|^select\.select$"
NAMES = set(re.findall(r"\w+", WAITS)) | {
    "waitid",
    "waitpid",
    "wait4",
    "check_call",
    "check_output",
}
# How many arguments come before the time-out, if not none.
BEFORE = {"communicate": 1, "wait_for": 1, "select": 3, "run": 20, "call": 20}
REASON = "# no time-out: "


def is_endless(call):
    if getattr(call.func, "attr", "") not in NAMES:
        return False
    name = ast.unparse(call.func)
    if re.search(r"^os\.wait(id|pid|4)$", name):
        return "WNOHANG" not in ast.unparse(call)
    # `HOST.get()` reads a context variable.
    if not re.search(WAITS, name) or name.removesuffix(".get").isupper():
        return False
    given = [word.value for word in call.keywords if word.arg in {"timeout", "timeout_s"}]
    given += call.args[BEFORE.get(name.rpartition(".")[2], 0) :]
    return ast.unparse(given[0]) == "None" if given else True


def endless_waits(source):
    """Yield the line of each call that has no time-out, and no reason for it beside or above."""
    lines = source.splitlines()
    for call in ast.walk(ast.parse(source)):
        if isinstance(call, ast.Call) and is_endless(call):
            beside = lines[max(call.lineno - 2, 0) : call.end_lineno]
            if not any(REASON in line for line in beside):
                yield call.lineno


@pytest.mark.slow
def test_every_wait_has_a_time_out_or_says_what_bounds_it():
    assert [f"{path}:{n}" for path in SOURCES for n in endless_waits(path.read_text())] == []


def test_no_queue_is_bounded_so_that_no_put_into_one_blocks():
    made = re.compile(r"(?<!class )\b(Simple)?Queue\([^)]")
    assert [str(path) for path in SOURCES if made.search(path.read_text())] == []
