"""What a sweep's runs need, by content, so that it can go to another machine."""

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.replay.sources import Sources
from stepbus_orchestrator.run.folder import read_files
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_participant import read_file
from stepbus_schemas import WiringError
from stepbus_tools.whole_file import replaced

SOURCE_FOLDER, METRICS_FOLDER = "source", "metrics"


@dataclass(frozen=True, kw_only=True)
class Bundle:
    """A scenario with its files, and the modules of the user's metrics.

    files: name → content; names are relative to the scenario's folder. settings: what changes no
    result, and so is not in the scenario's text, such as deadlines. modules: of metrics, by
    `<number>/<path>`. metrics: `file.py:function` → the file in `modules`.
    """

    scenario: bytes
    files: Mapping[str, bytes]
    settings: Sequence[str]
    modules: Mapping[str, bytes]
    metrics: Mapping[str, str]

    def fingerprint(self) -> str:
        """Return the SHA-256 of all that determines a result."""
        digest = hashlib.sha256(self.scenario)
        for group in (self.files, self.modules):
            for name, content in sorted(group.items()):
                digest.update(f"\0{name}\0{len(content)}\0".encode() + content)
        return digest.hexdigest()

    def unpack(self, folder: Path) -> Path:
        """Write it to a new folder, and return the scenario's path.

        Raises RecordingFailed where it cannot be written.
        """
        scenario = Sources(self.scenario, self.files).unpack(folder / "scenario")
        for name, content in self.modules.items():
            with replaced(folder / METRICS_FOLDER / name) as part:
                part.write_bytes(content)
        return scenario


def collect(variants: Sequence[Scenario], metrics: Sequence[str]) -> Bundle:
    """Return the bundle of a scenario and of metrics such as `my.py:tracking`.

    variants: the scenario, and the same with values that name other files. Raises WiringError for
    a metric without a file, RecordingFailed for a file that cannot be read.
    """
    base = variants[0]
    named = {name: path for variant in variants for name, path in variant.files.items()}
    modules: dict[str, bytes] = {}
    places: dict[str, str] = {}
    for number, text in enumerate(metrics):
        path = metric_file(text)
        modules |= {f"{number}/{name}": data for name, data in _modules_beside(path).items()}
        places[text] = f"{number}/{path.name}"
    return Bundle(
        scenario=resolved(base).encode(),
        files=read_files(named),
        settings=_settings(base),
        modules=modules,
        metrics=places,
    )


def metric_file(text: str) -> Path:
    """Return the file of a metric such as `my.py:tracking`.

    Raises WiringError where there is no such file, or no such function in it.
    """
    name, colon, function = text.rpartition(":")
    path = Path(name)
    if not colon or not function.isidentifier() or path.suffix != ".py":
        raise WiringError(f"{text}: write FILE.py:FUNCTION, e.g. my_metrics.py:tracking")
    if not path.is_file():
        raise WiringError(f"{text}: no file {path}")
    try:
        text_of_file = read_file(path).decode("utf-8", "replace")
    except OSError as exc:
        raise WiringError(f"{text}: {path} cannot be read: {exc}") from exc
    if function not in text_of_file:
        raise WiringError(f"{text}: {path} has no function {function!r}")
    return path


def _modules_beside(path: Path) -> dict[str, bytes]:
    """Return name → content of a module and of the modules next to it, which it may import."""
    packages = sorted(init.parent for init in path.parent.glob("*/__init__.py"))
    beside = [
        *path.parent.glob("*.py"),
        *(f for package in packages for f in package.rglob("*.py")),
    ]
    chosen = dict.fromkeys([path, *sorted(beside)])
    return read_files({file.relative_to(path.parent).as_posix(): file for file in chosen})


def _settings(scenario: Scenario) -> list[str]:
    """Return the settings that are not in a scenario's text, since they change no result."""
    return [
        f"window={scenario.window}",
        f"batch={scenario.batch}",
        *(
            f"{spec.name}.{key.removesuffix('_s')}_timeout={limit_s}s"
            for spec in scenario.participants
            for key, limit_s in dataclasses.asdict(spec.deadlines).items()
        ),
    ]
