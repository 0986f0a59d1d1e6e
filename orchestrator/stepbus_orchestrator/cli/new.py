"""The folders `stepbus new` writes: a scenario, a controller in some language, what it needs.

They are the examples of the repository, so that what a user starts from is what the tests run.
"""

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

from stepbus_orchestrator.cli.commands import New
from stepbus_orchestrator.cli.terminal.output import say
from stepbus_orchestrator.plugins import STARTERS as STARTERS_OF
from stepbus_orchestrator.plugins import named_points, view
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

_PACKAGE = Path(__file__).parent / "starters"
_CHECKOUT = _PACKAGE.parents[3]
_MODEL_FILES = ("two_link.urdf", "world.yaml")
_NAME = re.compile(r"^name: .*$", re.MULTILINE)
_WORLD = re.compile(r'"?package://stepbus_scenarios/two_link/world\.yaml"?')


Part = tuple[str, str, str]
"""Folder of the starter, folder below this package or the checkout, and patterns of its files, so
that what a build has left beside them stays there."""


@dataclass(frozen=True, kw_only=True)
class Starter:
    """What a starter consists of.

    build: command that builds it, `{folder}` being the starter's folder; blank where none is
    needed. replace: texts of the examples that are others in a folder of its own.
    """

    parts: Sequence[Part]
    build: str = ""
    replace: Mapping[str, str] = field(default_factory=dict)


def _example(folder: str, files: str) -> Part:
    return (".", f"examples/controllers/{folder}", f".gitignore README.md scenario.yaml {files}")


STARTERS: Mapping[str, Starter] = {
    "c": Starter(parts=[_example("c", "Makefile *.c *.h")], build="make -C {folder}"),
    "java": Starter(parts=[_example("java", "*.java")]),
    "js": Starter(parts=[_example("javascript", "*.mjs *.js package.json")]),
    "octave": Starter(parts=[_example("octave", "*.m")]),
    "python": Starter(parts=[(".", "templates", "README.md controller.py scenario.yaml")]),
    "rust": Starter(
        parts=[
            _example("rust", "Cargo.toml Cargo.lock rustfmt.toml src/**/*.rs"),
            ("stepbus", "clients/rust", ".gitignore Cargo.toml src/**/*.rs"),
        ],
        build="cargo build --release --manifest-path {folder}/Cargo.toml",
        replace={"../../../clients/rust": "stepbus", "`clients/rust`": "`stepbus/`"},
    ),
}
"""Language, as `stepbus new --language` takes it → its starter."""


def write_starter(folder: Path, language: str) -> list[Path]:
    """Write a starter into a new or empty folder and return its files, relative to the folder.

    Raises WiringError when the folder is not empty or cannot be written.
    """
    contents = dict(_contents(STARTERS[language], _scenario_name(folder)))
    graph = view("wiring")(parse_yaml("scenario.yaml", contents[Path("scenario.yaml")]), {})
    contents[Path("README.md")] += f"\n## Wiring\n\n```mermaid\n{graph}\n```\n"
    return _write(folder, {file: text.encode() for file, text in contents.items()})


def write_starter_of(folder: Path, file: Path) -> list[Path]:
    """Write the starter of a file of another tool, such as an FMU; as `write_starter`."""
    known = named_points(STARTERS_OF)
    if file.suffix not in known:
        raise WiringError(f"{file} is no FMU; its name has to end with {' or '.join(known)}")
    if not file.is_file():
        raise WiringError(f"no file {str(file)!r}")
    contents = known[file.suffix].load()(file, _scenario_name(folder))
    return _write(folder, {Path(name): content for name, content in contents.items()})


def _write(folder: Path, contents: Mapping[Path, bytes]) -> list[Path]:
    try:
        if folder.exists() and any(folder.iterdir()):
            raise WiringError(f"{folder} is not empty; choose a new folder")
        for file, content in contents.items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_bytes(content)
    except OSError as exc:
        raise WiringError(f"{folder} cannot be written: {exc.strerror}") from exc
    return sorted(contents)


def _contents(starter: Starter, name: str) -> Iterator[tuple[Path, str]]:
    """Return the files of a starter, as paths relative to its folder, with their text."""
    for target, folder, patterns in starter.parts:
        source = _source(folder)
        for file in sorted({file for word in patterns.split() for file in source.glob(word)}):
            text = file.read_text(encoding="utf-8")
            for old, new in starter.replace.items():
                text = text.replace(old, new)
            if file.name == "scenario.yaml":
                # Under another name, with the world beside it.
                text = _WORLD.sub("world.yaml", _NAME.sub(f"name: {name}", text, count=1))
            yield Path(target, file.relative_to(source)), text
    model = files("stepbus_scenarios") / "two_link"
    for model_file in _MODEL_FILES:
        yield Path(model_file), (model / model_file).read_text(encoding="utf-8")


def _source(folder: str) -> Path:
    """Return a folder of this package, of the checkout, or of the copy the wheel has of that."""
    return next(root / folder for root in (_PACKAGE, _CHECKOUT) if (root / folder).is_dir())


def _scenario_name(folder: Path) -> str:
    """Return the name of a folder as that of a scenario, as YAML."""
    words = re.sub(r"[^A-Za-z0-9_-]+", "_", folder.absolute().name)
    name = words.lstrip("_-")[:64] or "my_scenario"
    # YAML reads some names, such as 1 or null, as something else.
    return name if parse_yaml("name", name) == name else f'"{name}"'


def new_command(given: New) -> int:
    """Write a starter, and print how to run it."""
    of = given.fmu
    files = (
        write_starter_of(given.folder, of) if of else write_starter(given.folder, given.language)
    )
    say(f"{given.folder}: {', '.join(map(str, files))}")
    name = shlex.quote(str(given.folder))
    build = "" if of else STARTERS[given.language].build.format(folder=name)
    say(f"next: {build} && stepbus run {name}" if build else f"next: stepbus run {name}")
    return 0
