"""Check the parameters of every participant that declares them, without starting it.

A Python program declares them as a class `Params` (`stepbus.Settings`): in the module `params` of
the package that `python -m` runs, or else in the module or script itself, where it may also be
imported from another one. That class is found in the source, not by running it.
"""

import ast
import importlib
import json
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from stepbus_participant import Problems, Settings, extra_hint, read_file
from stepbus_participant.parameters import find_problems

from .files.paths import is_file
from .model import ParticipantSpec, Scenario
from .program import PYTHON, module_file, python_target

_NAME = "Params"
_LONGEST_S = 30.0


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """Where a class of parameters is; module: its name, empty for a script."""

    file: Path
    module: str
    name: str = _NAME


def check_params(scenario: Scenario, problems: Problems) -> None:
    """Add what is wrong with the parameters of participants that declare them.

    Installed packages are imported here: their `params` load nothing heavy. What lies in the
    scenario's folder is the user's, and runs in a process of its own.
    """
    own: list[tuple[ParticipantSpec, Declaration]] = []
    for spec in scenario.participants:
        declaration = find_declaration(spec, scenario.folder)
        is_wrong = any(problems.has(("participants", spec.name, k)) for k in ("exec", "params"))
        if declaration is None or is_wrong:
            continue
        if declaration.file.is_relative_to(scenario.folder):
            own.append((spec, declaration))
            continue
        try:
            declared = getattr(importlib.import_module(declaration.module), declaration.name)
        except ModuleNotFoundError as exc:
            text = f"{declaration.module} needs {exc.name}, which is not installed"
            problems.add(("participants", spec.name), text + extra_hint(exc.name or ""))
            continue
        if isinstance(declared, type) and issubclass(declared, Settings):
            _add(problems, spec.name, find_problems(declared, spec.params, scenario.folder))
    if own:
        _check_separately(own, scenario.folder, problems)


def find_declaration(spec: ParticipantSpec, folder: Path) -> Declaration | None:
    """Return where a participant declares its parameters; None: nowhere."""
    if spec.exec[:1] != ("python",):
        return None
    launch, name = python_target(spec.exec[1:])
    if launch == "script" and is_file(folder / name):
        return _in_source(Declaration(file=folder / name, module=""), folder)
    if launch != "module":
        return None
    file = module_file(f"{name}.params", folder)
    if file is not None:
        return _in_source(Declaration(file=file, module=f"{name}.params"), folder)
    file = module_file(name, folder)
    return None if file is None else _in_source(Declaration(file=file, module=name), folder)


def _in_source(at: Declaration, folder: Path) -> Declaration | None:
    """Follow the name `Params` at the top of a module to the class."""
    try:
        tree = ast.parse(read_file(at.file))
    except (OSError, SyntaxError, ValueError):
        return None
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and node.name == at.name:
            return at
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                if (alias.asname or alias.name) == at.name:
                    return _imported(at, node, alias.name, folder)
    return None


def _imported(at: Declaration, node: ast.ImportFrom, name: str, folder: Path) -> Declaration | None:
    package = at.module if at.file.name == "__init__.py" else at.module.rpartition(".")[0]
    for _ in range(node.level - 1):
        package = package.rpartition(".")[0]
    parts = (package if node.level else "", node.module or "")
    module = ".".join(part for part in parts if part)
    file = module_file(module, folder)
    return None if file is None else Declaration(file=file, module=module, name=name)


def _check_separately(
    own: Iterable[tuple[ParticipantSpec, Declaration]], folder: Path, problems: Problems
) -> None:
    rows = list(own)
    requests = [
        {"file": str(at.file), "module": at.module, "name": at.name, "params": dict(spec.params)}
        for spec, at in rows
    ]
    words = [*PYTHON, "-m", "stepbus_participant.parameters"]
    try:
        done = subprocess.run(
            words,
            input=json.dumps(requests),
            capture_output=True,
            text=True,
            cwd=folder,
            timeout=_LONGEST_S,
            check=True,
        )
        answers = json.loads(done.stdout)
    except (subprocess.SubprocessError, ValueError) as exc:
        for spec, at in rows:
            text = f"{at.file.name} cannot be imported to check them: {exc}"
            problems.add(("participants", spec.name, "params"), text)
        return
    for (spec, _), found in zip(rows, answers, strict=True):
        _add(problems, spec.name, [(tuple(keys), message) for keys, message in found])


def _add(problems: Problems, name: str, found: Iterable[tuple[tuple[str | int, ...], str]]) -> None:
    for keys, message in found:
        problems.add(("participants", name, "params", *keys), message)
