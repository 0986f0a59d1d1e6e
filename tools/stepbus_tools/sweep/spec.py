"""What a sweep is: declared once, for the command line and for a file.

scenario: two_link
vary:
  - controller.params.kp=50:200:7
  - plant.params.gravity~uniform(9.7, 0.2)
samples: 500
"""

import dataclasses
import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec

from stepbus_orchestrator.errors import RecordingFailed, argument
from stepbus_participant import Count, Problems, Settings, Whole, read_text, write_file
from stepbus_participant.parameters import Keys, Place, read, read_yaml
from stepbus_schemas import WiringError
from stepbus_tools.sweep.axes import Axis, parse_axis
from stepbus_tools.sweep.design import Design

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
        fields: dict[str, Any] = json.loads(msgspec.json.encode(self))
        return fields


def draft(scenario: str, options: Mapping[str, Any]) -> tuple[Spec, Problems]:
    """Return the sweep of a scenario, or of a sweep's file, and what is wrong with it by itself.

    options: take the place of what the file has. What is wrong is replaced by its default.
    """
    path = Path(scenario)
    if not (path.is_file() and _is_sweep(path)):
        problems = Problems()
        data = {"scenario": scenario, **options}
    else:
        file = read_yaml(path, _LIKE)
        data = {**file.data, **options}
        places = {at: place for at, place in file.places.items() if at[0] not in options}
        places |= {(key,): Place(file="", line=0) for key in options}
        problems = dataclasses.replace(file, places=places).problems()
        for key in ("scenario", "metrics"):
            if key in file.data and key not in options:
                data[key] = _beside(path.parent, data[key])
    spec = read(Spec, data, problems)
    for keys, text in _contradictions(spec):
        if not problems.has(keys):
            problems.add(keys, text)
    return spec, problems


def _contradictions(spec: Spec) -> Iterator[tuple[Keys, str]]:
    """Yield what does not go together in a sweep."""
    usual = Spec(scenario="")
    yield from _optimizer_problems(spec, usual)
    if not spec.vary:
        yield ("vary",), "needs at least one axis, e.g. controller.params.kp=50:200:7"
    axes = []
    for index, text in enumerate(spec.vary):
        try:
            axes.append(parse_axis(text))
        except WiringError as exc:
            yield ("vary", index), str(exc)
        else:
            is_optimized = spec.optimize is not None
            yield from _axis_problems(axes[-1], ("vary", index), is_optimized=is_optimized)
    is_drawn = len(axes) < len(spec.vary) or any(axis.distribution for axis in axes)
    if spec.optimize is None and spec.sampling != usual.sampling and not is_drawn:
        yield ("sampling",), "no axis has a distribution to draw from"


def _optimizer_problems(spec: Spec, usual: Spec) -> Iterator[tuple[Keys, str]]:
    if spec.optimize is None:
        if spec.trials or spec.maximize:
            yield ("optimize",), "names the metric that trials are for"
        if spec.batch != usual.batch:
            yield ("batch",), "belongs to an optimizer; without one, all runs are asked for at once"
    else:
        if not spec.trials:
            yield (
                ("trials",),
                f"an optimizer needs a number of runs in {argument('--trials')}, e.g. 100",
            )
        for key in ("samples", "repeats", "sampling"):
            if getattr(spec, key) != getattr(usual, key):
                yield (key,), "an optimizer chooses each run by itself; leave it out"


def _axis_problems(axis: Axis, keys: Keys, *, is_optimized: bool) -> Iterator[tuple[Keys, str]]:
    if not is_optimized and axis.span is not None:
        text = f"{axis.text}: a range needs a count, e.g. {axis.text}:7; only an optimizer"
        yield keys, f"{text} takes all of it"
    if is_optimized and (axis.distribution or len(axis.paths) > 1):
        yield keys, f"{axis.text}: an optimizer takes ranges and lists, such as PATH=50:200"


def _beside(folder: Path, value: Any) -> Any:
    """Return file names relative to where we are; a name that is no file stays."""
    if isinstance(value, list):
        return [_beside(folder, one) for one in value]
    name = str(value).rpartition(":")[0] if str(value).count(".py:") else str(value)
    return str(folder / str(value)) if (folder / name).exists() else value


def _is_sweep(path: Path) -> bool:
    """Return whether a file is that of a sweep: it names a scenario."""
    try:
        text = read_text(path, errors="replace")
    except OSError:
        # Who reads it as a scenario says what is wrong with it.
        return False
    return any(line.startswith(("scenario:", "vary:")) for line in text.splitlines())


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
        return Spec.of(content["sweep"]), str(content["fingerprint"])
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
