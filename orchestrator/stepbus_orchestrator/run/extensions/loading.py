"""Extensions of the user's own, named as `FILE.py:Class` or `module:Class`."""

from pathlib import Path

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_participant import load_class
from stepbus_schemas import WiringError, error_text


def load_extension(name: str) -> RunExtension:
    """Return an instance of the class that a name such as `limits.py:Limit` names.

    Raises WiringError where there is no such file or class, it is no RunExtension, or it cannot be
    made without arguments.
    """
    file, _, class_name = name.rpartition(":")
    folder, module = Path(), file
    if file.endswith(".py"):
        path = Path(file)
        if not path.is_file():
            raise WiringError(f"{name}: no file {file!r}")
        folder, module = path.parent, path.stem
    found = load_class(f"{module}:{class_name}", folder.resolve())
    if not issubclass(found, RunExtension):
        raise WiringError(f"{name}: {class_name} is no stepbus.RunExtension")
    try:
        made: RunExtension = found()
    except Exception as exc:
        raise WiringError(f"{name} cannot be made: {error_text(exc)}") from exc
    return made
