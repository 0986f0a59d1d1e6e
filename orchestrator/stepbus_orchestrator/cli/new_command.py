"""`stepbus new`: a scenario with a controller of one's own, to start from."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path

from stepbus_schemas import WiringError

from .command import Command
from .output import say

_TEMPLATES = Path(__file__).parent.parent / "templates"
_MODEL_FILES = ("two_link.urdf", "world.yaml")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="folder to make; must not hold anything yet")


def _execute(args: argparse.Namespace) -> int:
    folder: Path = args.folder
    # pip compiles what it installs, so that a folder may stand beside the templates.
    templates = sorted(file for file in _TEMPLATES.iterdir() if file.is_file())
    sources = [*templates, *_model_files()]
    try:
        if folder.exists() and any(folder.iterdir()):
            raise WiringError(f"{folder} holds something already; choose a new folder")
        folder.mkdir(parents=True, exist_ok=True)
        for source in sources:
            (folder / source.name).write_bytes(source.read_bytes())
    except OSError as exc:
        raise WiringError(f"{folder} cannot be written: {exc.strerror}") from exc
    say(f"{folder}: {', '.join(source.name for source in sources)}")
    say(f"next: stepbus run {folder}")
    return 0


def _model_files() -> list[Path]:
    spec = find_spec("stepbus_scenarios")
    if spec is None or not spec.submodule_search_locations:
        raise WiringError("the package stepbus_scenarios is missing; install stepbus again")
    folder = Path(next(iter(spec.submodule_search_locations))) / "two_link"
    return [folder / name for name in _MODEL_FILES]


COMMAND = Command(
    name="new",
    summary="make a scenario with a controller of your own",
    description="Makes a folder with a scenario of the built-in plant and mission, its model, "
    "and a controller of 15 lines to change. It runs as it is.",
    examples=("stepbus new my_scenario",),
    add_arguments=_add_arguments,
    execute=_execute,
)
