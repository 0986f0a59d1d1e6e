"""What a sweep is: declared once, for the command line and for a file.

scenario: two_link
vary:
  - controller.params.kp=50:200:7
  - plant.params.gravity~uniform(9.7, 0.2)
samples: 500
"""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_participant import Count, Settings, Whole, read_text, write_file
from stepbus_participant.parameters import Keys, read, read_yaml
from stepbus_schemas import WiringError

from .space import Axis, Design, parse_axis

SPEC_FILE = "sweep.json"
_LIKE = "a sweep is a map with `scenario` and `vary`"


class Spec(Settings):
    """What a sweep runs, and what of it stays."""

    scenario: str
    """A scenario file, relative to the sweep's, a folder, or the name of a built-in one."""
    set: tuple[str, ...] = ()
    """What is the same in all runs: `PATH=VALUE`."""
    vary: tuple[str, ...] = ()
    """The axes: `PATH=VALUES` or `PATH~DISTRIBUTION`."""
    samples: Whole = 0
    """How many values are drawn from each distribution."""
    sampling: Literal["random", "latin", "sobol", "halton"] = "random"
    """How they are drawn: independently, or so that they fill the space."""
    seed: Whole = 0
    """What the draws depend on, and the choices of an optimizer."""
    repeats: Count = 1
    """Runs of each point, each with another `seed` of the scenario."""
    metrics: tuple[str, ...] = ()
    """Your own metrics: `FILE.py:FUNCTION`, relative to the sweep's file."""
    optimize: str | None = None
    """The metric that an optimizer makes small; the axes are ranges without a count, lists, or
    `uniform`."""
    maximize: bool = False
    """Make it large instead."""
    trials: Whole = 0
    """How many runs the optimizer has."""
    batch: Count = 4
    """How many of them it asks for at once, however many cores there are."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what does not go together."""
        if not self.vary:
            yield ("vary",), "needs at least one axis, e.g. controller.params.kp=50:200:7"
        if self.optimize is not None and not self.trials:
            yield ("trials",), "an optimizer needs a number of runs, e.g. --trials 100"
        if self.optimize is None and (self.trials or self.maximize):
            yield ("optimize",), "names the metric that trials are for"
        for index, text in enumerate(self.vary):
            try:
                axis = parse_axis(text)
            except WiringError as exc:
                yield ("vary", index), str(exc)
            else:
                yield from self._axis_problems(axis, ("vary", index))

    def _axis_problems(self, axis: Axis, keys: Keys) -> Iterator[tuple[Keys, str]]:
        if self.optimize is None and axis.span is not None:
            text = f"{axis.text}: a range needs a count, e.g. {axis.text}:7; only an optimizer"
            yield keys, f"{text} takes all of it"
        if self.optimize is not None and (axis.distribution or len(axis.paths) > 1):
            yield keys, f"{axis.text}: an optimizer takes ranges and lists, such as PATH=50:200"

    def axes(self) -> list[Axis]:
        """Return its axes; raises WiringError for one that is none."""
        return [parse_axis(text) for text in self.vary]

    def design(self, first_seed: int = 0) -> Design:
        """Return its runs; raises WiringError for axes that do not go together."""
        return Design(
            self.axes(),
            samples=self.samples,
            sampling=self.sampling,
            seed=self.seed,
            repeats=self.repeats,
            first_seed=first_seed,
        )

    def plain(self) -> dict[str, Any]:
        """Return it as plain data, as a file has it."""
        found: dict[str, Any] = json.loads(msgspec.json.encode(self))
        return found


def read_spec(path: Path, options: Mapping[str, Any]) -> Spec:
    """Return the sweep of a file, some of it replaced; file names are relative to the file.

    Raises SettingsError with every problem.
    """
    file = read_yaml(path, _LIKE)
    data = {**file.data, **options}
    for key in ("scenario", "metrics"):
        if key in file.data and key not in options:
            data[key] = _beside(path.parent, data[key])
    problems = file.problems()
    spec = read(Spec, data, problems)
    problems.refuse()
    return spec


def _beside(folder: Path, value: Any) -> Any:
    """Return file names relative to where we are; a name that is no file stays."""
    if isinstance(value, list):
        return [_beside(folder, one) for one in value]
    name = str(value).rpartition(":")[0] if str(value).count(".py:") else str(value)
    return str(folder / str(value)) if (folder / name).exists() else value


def find_spec(scenario: str, options: Mapping[str, Any]) -> Spec:
    """Return the sweep of a scenario, or that of a sweep's file, some of it replaced.

    Raises SettingsError with every problem.
    """
    path = Path(scenario)
    if path.is_file() and _is_sweep(path):
        return read_spec(path, options)
    return make_spec({"scenario": scenario, **options})


def _is_sweep(path: Path) -> bool:
    """Return whether a file is that of a sweep: it names a scenario."""
    try:
        text = read_text(path, errors="replace")
    except OSError:
        # Who reads it as a scenario says what is wrong with it.
        return False
    return any(line.startswith(("scenario:", "vary:")) for line in text.splitlines())


def make_spec(options: Mapping[str, Any]) -> Spec:
    """Return a sweep from its settings alone; raises SettingsError with every problem."""
    from stepbus_participant import Problems  # noqa: PLC0415

    problems = Problems()
    spec = read(Spec, dict(options), problems)
    problems.refuse()
    return spec


def save_spec(folder: Path, spec: Spec, fingerprint: str) -> None:
    """Write a sweep to its folder; raises RecordingFailed where that cannot be."""
    content = {"sweep": spec.plain(), "fingerprint": fingerprint}
    path = folder / SPEC_FILE
    try:
        write_file(path, f"{json.dumps(content, indent=2)}\n".encode())
    except OSError as exc:
        raise RecordingFailed(f"{path} cannot be written: {exc.strerror}") from exc


def load_spec(folder: Path) -> tuple[Spec, str]:
    """Return the sweep of a folder, and the fingerprint of its files.

    Raises WiringError where the folder holds none.
    """
    path = folder / SPEC_FILE
    try:
        content = json.loads(read_text(path))
        return make_spec(content["sweep"]), str(content["fingerprint"])
    except FileNotFoundError as exc:
        raise WiringError(f"{folder} holds no sweep: there is no {SPEC_FILE} in it") from exc
    except (OSError, ValueError, KeyError, TypeError) as exc:
        raise WiringError(f"{path} is not the one that a sweep wrote: {exc}") from exc


def default_name(spec: Spec) -> str:
    """Return a folder's name, the same for the same sweep."""
    stem = re.sub(r"\W+", "_", Path(spec.scenario).with_suffix("").as_posix()).strip("_")
    return f"{stem}-{hashlib.sha256(json.dumps(spec.plain()).encode()).hexdigest()[:8]}"


def differences(old: Spec, new: Spec) -> list[str]:
    """Return the settings in which two sweeps differ."""
    before, now = old.plain(), new.plain()
    return [
        f"{key} was {before[key]!r}, now it is {now[key]!r}"
        for key in now
        if before[key] != now[key]
    ]
