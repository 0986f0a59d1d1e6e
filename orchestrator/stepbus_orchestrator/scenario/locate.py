"""Where a scenario is: a file, a folder, or one of those that ship with stepbus."""

from importlib.util import find_spec
from pathlib import Path

from stepbus_orchestrator.plugins import points
from stepbus_orchestrator.scenario.scenario_files import is_file, is_scenario
from stepbus_participant import extra_hint, suggest
from stepbus_participant.parameters import fatal

MAIN_FILE = "scenario.yaml"


def locate(name: str | Path) -> Path:
    """Return the absolute path of a scenario's file.

    name: a YAML file, a folder with a scenario.yaml, or the name of a built-in scenario such as
    `two_link` (its scenario.yaml) or `two_link/pd` (its pd.yaml).

    Raises SettingsError when there is no such scenario.
    """
    path = locate_from(str(name), Path())
    if path is None:
        raise fatal(str(name), _missing(Path(name), str(name)))
    return path.resolve()


def locate_from(name: str, folder: Path) -> Path | None:
    """Return the file of a scenario as `locate` does, relative to a folder; None: there is none."""
    paths = (folder / name, folder / name / MAIN_FILE)
    return next(filter(is_file, paths), None) or _builtin_files().get(name)


def package_url(file: Path) -> str | None:
    """Return the `package://` name of a file that ships with stepbus; None of any other."""
    for package, folder in scenario_folders().items():
        if file.is_relative_to(folder):
            path = file.relative_to(folder).as_posix()
            return f"package://{package.replace('.', '/')}/{path}"
    return None


def _missing(path: Path, name: str) -> str:
    hint = extra_hint(name.partition("/")[0])
    if hint and not path.suffix:
        return f"that scenario is not installed{hint}"
    if path.is_dir():
        return f"the folder has no {MAIN_FILE}"
    if path.suffix in {".yaml", ".yml"} or name.startswith((".", "/")):
        return f"no such file or folder (looked in {Path.cwd()})"
    return (
        "no such file, folder or built-in scenario (give the path of your own, e.g. "
        f"./my_robot/{MAIN_FILE}){suggest(name, builtin_names())}"
    )


def builtin_names() -> tuple[str, ...]:
    """Return the names of the scenarios that ship with stepbus, sorted."""
    return tuple(_builtin_files())


def builtin_name(file: Path) -> str | None:
    """Return the name of the scenario that ships in a file; None of any other file."""
    return next((name for name, known in _builtin_files().items() if known == file), None)


def _builtin_files() -> dict[str, Path]:
    """Return the built-in scenarios by name, sorted."""
    files = [file for folder in scenario_folders().values() for file in folder.glob("*/*.yaml")]
    return {_name(file): file.resolve() for file in sorted(files, key=_name) if is_scenario(file)}


def _name(file: Path) -> str:
    folder = file.parent.name
    return folder if file.name == MAIN_FILE else f"{folder}/{file.stem}"


def scenario_folders() -> dict[str, Path]:
    """Return package → folder of the scenarios that installed packages declare."""
    names = sorted({point.value for point in points("stepbus.scenarios")})
    folders = {name: _folder(name) for name in names}
    return {name: folder for name, folder in folders.items() if folder is not None}


def _folder(package: str) -> Path | None:
    """Return the folder of a package; imports nothing."""
    top, *below = package.split(".")
    spec = find_spec(top)
    if spec is None or not spec.submodule_search_locations:
        return None
    folder = Path(next(iter(spec.submodule_search_locations)), *below).resolve()
    return folder if folder.is_dir() else None
