"""Every wait of the orchestrator, and of a participant, is listed with its deadline."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "waits.md"
PACKAGES = ("orchestrator/stepbus_orchestrator", "participant/stepbus_participant")
METHODS = {"acquire", "communicate", "get", "join", "query", "receive", "wait", "wait_for"}
PIPES = re.compile(r"^[\w.]*\bstd(in|out|err)( or \(\))?$")
FUNCTIONS = {
    *("os.fsync", "os.read", "os.wait4", "os.waitid", "os.waitpid", "select.select", "time.sleep"),
    *("subprocess.Popen", "subprocess.call", "subprocess.check_call", "subprocess.check_output"),
    *("subprocess.run", "zenoh.open"),
}
PUTS = {"put", "_put", "_put_batch", "put_ready", "_put_start", "_put_stop", "_put_trigger"}
CLOSES = {"bus.close", "self._bus.close", "self._session.close", "self._process.stdin.close"}
TIMEOUT_AT = {"query": 3, "select": 3, "wait_for": 1}


class Wait(NamedTuple):
    """One call that may block. timeout: its expression; empty where it has none."""

    file: str
    function: str
    call: str
    timeout: str


def waits_in(source: str, file: str = "x.py") -> Iterator[Wait]:
    """Yield all calls, and locks taken by `with`, that may block."""
    tree = ast.parse(source)

    def visit(node: ast.AST, names: tuple[str, ...]) -> Iterator[Wait]:
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            names = (*names, node.name)
        where = file, ".".join(names)
        if isinstance(node, ast.Call) and is_wait(node):
            yield Wait(*where, ast.unparse(node.func), timeout_of(node))
        if isinstance(node, ast.Call):
            texts = (ast.unparse(argument) for argument in node.args)
            yield from (Wait(*where, text, "") for text in texts if text in CLOSES)
        if isinstance(node, ast.For) and PIPES.search(text := ast.unparse(node.iter)):
            yield Wait(*where, text, "")
        if isinstance(node, ast.With):
            for text in (ast.unparse(item.context_expr) for item in node.items):
                if re.search(r"_?(lock|changed|condition)$", text, re.IGNORECASE):
                    yield Wait(*where, f"with {text}", "")
        for child in ast.iter_child_nodes(node):
            yield from visit(child, names)

    yield from visit(tree, ())


def is_wait(call: ast.Call) -> bool:
    """Return whether a call may block until somebody else does something."""
    text = ast.unparse(call.func)
    name = text.rpartition(".")[2]
    if text in FUNCTIONS | CLOSES or name in PUTS:
        return name != "put" or not re.search("queue|inbox", text)
    if name in {"read", "readline"}:
        return PIPES.search(text.rpartition(".")[0]) is not None
    if not isinstance(call.func, ast.Attribute) or name not in METHODS:
        return False
    if name == "get":
        # Of a map, it takes the key; of a context variable, nothing.
        return not call.args and not text.isupper() and not text.split(".")[0].isupper()
    # Of texts and paths, it takes one or several of them.
    return name != "join" or not call.args or ast.unparse(call.args[0]).endswith("_S")


def timeout_of(call: ast.Call) -> str:
    """Return the time-out that a call is given."""
    for keyword in call.keywords:
        if keyword.arg in {"timeout", "timeout_s"}:
            return ast.unparse(keyword.value)
    name = ast.unparse(call.func).rpartition(".")[2]
    at = TIMEOUT_AT.get(name, 0)
    if name in (METHODS | {"select", "sleep"}) - {"communicate"} and len(call.args) > at:
        return ast.unparse(call.args[at])
    return ""


@cache
def found() -> list[Wait]:
    """Return all waits of the code."""
    return [
        wait
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for wait in waits_in(path.read_text(), str(path.relative_to(ROOT / package).as_posix()))
    ]


@cache
def listed() -> dict[Wait, str]:
    """Return wait → its bound, of all rows of the page; bound: what stands for a time-out."""
    rows = {}
    for line in PAGE.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split(" | ")]
        if len(cells) != 4 or not cells[0].startswith("`"):
            continue
        file, function = re.findall("`([^`]*)`", cells[0])
        timeout = re.match("`([^`]*)`", cells[2])
        text = timeout.group(1) if timeout else ""
        bound = "" if timeout else cells[2].partition(":")[0].partition(",")[0]
        rows[Wait(file, function, cells[1].strip("`"), text)] = bound
        assert cells[3], line
    return rows


def bounds() -> set[str]:
    """Return what may bound a wait that has no time-out, as the page defines it."""
    return set(re.findall(r"^- \*\*([^*]+)\*\*:", PAGE.read_text(), re.MULTILINE))


@pytest.mark.slow
def test_every_wait_is_listed_with_its_deadline():
    assert sorted(set(found()) - set(listed())) == []


def test_every_listed_wait_is_there():
    assert sorted(set(listed()) - set(found())) == []


def test_what_has_no_time_out_is_bounded_by_something_that_the_page_defines():
    assert {bound for wait, bound in listed().items() if not wait.timeout} == bounds()


def test_no_queue_is_bounded_so_that_no_put_into_one_blocks():
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Call) and re.search(
                    r"\b(Simple)?Queue$", ast.unparse(node.func)
                ):
                    assert not node.args, f"{path}:{node.lineno}"
                    assert not node.keywords, f"{path}:{node.lineno}"


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("thread.join()", [("thread.join", "")]),
        ("thread.join(_LAST_S)", [("thread.join", "_LAST_S")]),
        ("', '.join(names); os.path.join(a, b)", []),
        ("queue.get(); rows.get(key); rows.get(key, 1)", [("queue.get", "")]),
        ("q.get(timeout=left)", [("q.get", "left")]),
        ("self._put(data); self._queue.put(1)", [("self._put", "")]),
        ("select.select([a], [], []); select.select([a], [], [], 1)", [("select.select", "")]),
        ("with self._lock, other:\n    pass", [("with self._lock", "")]),
        ("subprocess.run(words, timeout=5.0)", [("subprocess.run", "5.0")]),
        ("child.communicate(data)", [("child.communicate", "")]),
    ],
)
def test_waits_are_found(code, expected):
    assert [(wait.call, wait.timeout) for wait in waits_in(code)][: len(expected)] == expected
    assert bool(list(waits_in(code))) == bool(expected)
