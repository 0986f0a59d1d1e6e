"""The examples of the docs and of docstrings do what is written beside them."""

import ast
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from support.paths import CHECKOUT
from sybil import Sybil
from sybil.document import PythonDocStringDocument
from sybil.parsers.markdown import CodeBlockParser, SkipParser
from sybil.parsers.rest import DocTestParser

import stepbus
from stepbus_orchestrator.cli.dispatch import parsed
from stepbus_orchestrator.errors import ExitCode

PAGES = [
    *sorted(CHECKOUT.glob("*.md")),
    *sorted((CHECKOUT / "docs").rglob("*.md")),
    *sorted((CHECKOUT / "scenarios").glob("*/*/*.md")),
    CHECKOUT / "examples/README.md",
    CHECKOUT / "benchmarks/README.md",
]
SOURCES = ("api", "schemas", "participant", "orchestrator", "tools", "services")
NUMBER = re.compile(r"[0-9a-f]{12,}|[-+−]?\b\d[\d.,:]*(?:e[-+]?\d+)?|(?<=-)\d{6,}")
PROGRESS = re.compile(r"^[\w ]+: (?:starting, waiting for|step \d).*\n?", re.MULTILINE)
"""Comes every two seconds: how often depends on the machine."""
FRAME = re.compile(r"[\s─━┃│┏┓┗┛┡┩└┘┳┻╇┴┼┬├┤╋]+")


def run_python(example):
    """Execute a block; a program that ends in `raise SystemExit(main(…))` is only imported."""
    tree = ast.parse(example.parsed)
    tree.body = [node for node in tree.body if not isinstance(node, ast.Raise)]
    exec(compile(tree, f"{example.path}:{example.line}", "exec"), example.namespace)


def run_console(example):
    """Execute the stepbus commands of a block and compare what they print, up to numbers."""
    for command, expected in commands_in(example.parsed):
        if not command.startswith("stepbus "):
            continue
        program = [Path(sys.executable).with_name("stepbus"), *shlex.split(command)[1:]]
        environment = {**os.environ, "COLUMNS": "120"}
        done = subprocess.run(program, check=False, capture_output=True, text=True, env=environment)
        shown = f"$ {command}\n{done.stdout}{done.stderr}"
        assert done.returncode in (ExitCode.FINISHED, ExitCode.DIFFERENT), shown
        assert matches(expected, done.stdout, done.stderr), shown


def commands_in(block):
    """Return (command, what it prints) of a console block."""
    parts = re.split(r"^\$ ", block.replace("\\\n", " "), flags=re.MULTILINE)[1:]
    return [(first, rest.strip()) for first, _, rest in (part.partition("\n") for part in parts)]


def matches(expected, *streams):
    """Return whether streams print what a page shows: `…` is any text, a number any number."""
    wanted = [re.escape(part.strip()) for part in comparable(expected).split("…")]
    pattern = re.compile(".*".join(wanted), re.DOTALL)
    orders = ("".join(streams), "".join(reversed(streams)), streams[0])
    return not expected or any(pattern.fullmatch(comparable(text)) for text in orders)


def comparable(text):
    """Return a text with # for every number, without progress, frames and runs of spaces."""
    return FRAME.sub(" ", NUMBER.sub("#", PROGRESS.sub("", text))).strip()


BLOCKS = Sybil(
    [CodeBlockParser("python", run_python), CodeBlockParser("console", run_console), SkipParser()]
)
DOCSTRINGS = Sybil(
    [DocTestParser(), CodeBlockParser("python", run_python)],
    document_types={".py": PythonDocStringDocument},
)


def name_of(path):
    return str(path.relative_to(CHECKOUT))


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if re.search("```(python|console)", page.read_text())],
    ids=name_of,
)
def test_the_examples_of_a_page_work_one_after_the_other(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, content in re.findall(
        r"<!-- (\w+\.\w+) -->\n```\w+\n(.*?)```", page.read_text(), re.DOTALL
    ):
        (tmp_path / name).write_text(content)
    for example in BLOCKS.parse(page).examples():
        example.evaluate()


@pytest.mark.parametrize(
    "source",
    [
        path
        for folder in SOURCES
        for path in sorted((CHECKOUT / folder).rglob("*.py"))
        if re.search(r"^ *(>>> |```python)", path.read_text(), re.MULTILINE)
    ],
    ids=name_of,
)
def test_the_examples_of_docstrings_work(source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    document = DOCSTRINGS.parse(source)
    document.namespace["stepbus"] = stepbus
    examples = list(document.examples())
    for example in examples:
        example.evaluate()
    assert examples


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_command_line_of_a_page_can_be_parsed(page):
    lines = re.findall(
        r"^(?:\$ )?(stepbus (?!\w+: )(?:[^\n\\]|\\\n)+)$", code_of(page), re.MULTILINE
    )
    for line in lines:
        _, *words = shlex.split(line.replace("\\\n", " "), comments=True)
        assert words[0].startswith("-") or {"-h", "--help"} & {*words} or parsed(*words), line


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_make_target_of_a_page_exists(page):
    targets = re.findall(r"^([a-z-]+):", (CHECKOUT / "Makefile").read_text(), re.MULTILINE)
    named = re.findall(r"(?:`|^)(?:\$ )?make ([a-z][a-z-]*)", page.read_text(), re.MULTILINE)
    assert set(named) <= set(targets)


def code_of(page):
    """Return what stands in the fenced blocks of a page."""
    return "\n".join(
        re.findall(r"^```(?:\w+)?\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    )
