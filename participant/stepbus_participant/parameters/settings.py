"""`Settings`: parameters declared once, as a class with types, bounds, defaults and descriptions.

    class Params(Settings):
        \"\"\"Parameters of my controller.\"\"\"

        joints: Names
        \"\"\"Joints under control, in the order of every vector.\"\"\"
        kp: PerJoint = each(100.0)
        \"\"\"Proportional gain [N·m/rad].\"\"\"

From it come the reading with all problems at once (`read.py`), the tables of the documentation
and the JSON Schema for editors (`describe.py`). docs/reference/parameters.md is the guide.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, dataclass_transform

import msgspec

from stepbus_participant.hints import suggest
from stepbus_schemas import WiringError

from .problems import Keys, Problems

__all__ = [
    "Count",
    "Duration",
    "File",
    "Finite",
    "ModelFile",
    "Name",
    "Names",
    "NonNegative",
    "NonNegativePerJoint",
    "PerJoint",
    "PerName",
    "Plugin",
    "Positive",
    "PositivePerJoint",
    "Settings",
    "Share",
    "Text",
    "Vector3",
    "Whole",
    "each",
    "needed_when",
    "when",
]

_DURATION = r"^[0-9.]+(/[0-9]+)? *(ns|us|µs|μs|ms|s|min|h)$"
NAME_FORM = "[A-Za-z0-9][A-Za-z0-9_-]*"
LONGEST_NAME = 64


def _key(name: str) -> str:
    """Return the key of a field: without the unit of durations, `latency_ns` → `latency`."""
    return name.removesuffix("_ns").removesuffix("_")


class _SettingsMeta(msgspec.StructMeta):
    """Makes every subclass frozen and keyword-only, with unknown keys refused."""

    def __new__(
        cls, name: str, bases: tuple[type, ...], namespace: dict[str, Any], **options: Any
    ) -> Any:
        options = {"frozen": True, "kw_only": True, "rename": _key, **options}
        return super().__new__(cls, name, bases, namespace, **options)


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(msgspec.field,))
class Settings(msgspec.Struct, metaclass=_SettingsMeta, frozen=True):
    """A set of parameters: one field for each key; see `read` of this package for what is checked.

    short: key that a text stands for, where the scenario has a text and no map in this place.
    """

    short: ClassVar[str] = ""

    @classmethod
    def elsewhere(cls, key: str) -> str:  # noqa: ARG003
        """Return where a key belongs that is none of these; nothing: nobody knows."""
        return ""

    def problems(self) -> Iterable[tuple[Keys, str]]:
        """Yield what is wrong among values that are fine one by one: keys and a sentence."""
        return ()

    def file_problems(self) -> Iterable[tuple[Keys, str]]:
        """Yield what is wrong in files, for `stepbus validate`; called where all else is fine."""
        return ()

    @classmethod
    def of(cls, data: Mapping[str, Any], folder: Path | None = None) -> Self:
        """Return plain data as these settings.

        folder: what relative file names are relative to; None: files are not checked.
        Raises SettingsError that lists every problem.
        """
        from .read import read  # noqa: PLC0415  `read` needs this class

        problems = Problems()
        settings = read(cls, data, problems, folder=folder)
        problems.refuse()
        return settings


class PerName:
    """One number for all joints, one each, or a map by joint; `of` gives one for each joint.

    value: a number, a list or a map. keys: where it stands, for messages.
    """

    def __init__(
        self, value: float | Sequence[float] | Mapping[str, float], keys: Keys = ()
    ) -> None:
        self._value = value
        self._keys = keys

    def of(self, names: Sequence[str]) -> list[float]:
        """Return one number for each name; raises SettingsError where that does not fit."""
        problems = Problems()
        for keys, text in self.misfits(names):
            problems.add((*self._keys, *keys), text)
        problems.refuse()
        if isinstance(self._value, Mapping):
            return [self._value[name] for name in names]
        value = self._value
        return list(value) if isinstance(value, Sequence) else [value] * len(names)

    def misfits(self, names: Sequence[str]) -> Iterator[tuple[Keys, str]]:
        """Yield why the numbers do not fit the names."""
        value = self._value
        if isinstance(value, Mapping):
            for name in value:
                if name not in names:
                    yield (name,), f"no joint {name!r}{suggest(name, names)}"
            for name in names:
                if name not in value:
                    yield (), f"{name!r} is missing"
        elif isinstance(value, Sequence) and len(value) != len(names):
            yield (), f"has {len(value)} numbers, not {len(names)} ({', '.join(names)})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PerName) and other._value == self._value

    def __hash__(self) -> int:
        return hash(repr(self._value))

    def __repr__(self) -> str:
        return f"each({self._value!r})"


def each(value: float) -> PerName:
    """Return a default: the same number for every joint."""
    return PerName(value)


def when(**values: str | bool | tuple[str, ...]) -> msgspec.Meta:
    """Return a mark: a key means something only where others have these values.

    `Annotated[Positive, when(smoothing="low_pass")]` is required then, unless it has a default,
    and refused otherwise.
    """
    wanted = {key: value if isinstance(value, tuple) else (value,) for key, value in values.items()}
    return msgspec.Meta(extra={"when": wanted})


def needed_when(**values: str | bool | tuple[str, ...]) -> msgspec.Meta:
    """Return a mark like `when`, for a key that is ignored beside other values, not refused."""
    marked = when(**values)
    return msgspec.Meta(extra={**(marked.extra or {}), "ignored": True})


def _text_form(mark: str, pattern: str) -> msgspec.Meta:
    schema = {"type": "string", "pattern": pattern}
    return msgspec.Meta(extra={"read": mark}, extra_json_schema=schema)


Finite = Annotated[float, msgspec.Meta(ge=-1e300, le=1e300)]
"""A finite number."""
NonNegative = Annotated[float, msgspec.Meta(ge=0, le=1e300)]
"""A finite number that is not negative."""
Positive = Annotated[float, msgspec.Meta(gt=0, le=1e300)]
"""A finite number above 0."""
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
"""A number from 0 to 1."""
Count = Annotated[int, msgspec.Meta(ge=1, le=2**63 - 1)]
"""A whole number, at least 1."""
Whole = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""A whole number that is not negative."""
Vector3 = tuple[Finite, Finite, Finite]
"""Three finite numbers."""
Text = Annotated[str, msgspec.Meta(min_length=1)]
"""A text that is not empty, such as the name of a link."""
Name = Annotated[str, _text_form("name", f"^{NAME_FORM}$"), msgspec.Meta(max_length=LONGEST_NAME)]
"""Name of a scenario, a participant or a port."""
Duration = Annotated[int, _text_form("duration", _DURATION)]
"""`5ms`, `0.005s` or `1/200s`; the field has it in [ns], and `_ns` behind its name."""
Pause = Annotated[int, _text_form("pause", _DURATION)]
"""A duration that may also be 0: `0s`."""
File = Annotated[Path, msgspec.Meta(extra={"read": "file"}, extra_json_schema={"type": "string"})]
"""A file: relative to the scenario or the file that names it, absolute, or `package://…`."""
ModelFile = Annotated[
    Path, msgspec.Meta(extra={"read": "model"}, extra_json_schema={"type": "string"})
]
"""A robot's URDF, `.xacro` or SDF, named like a `File`; its physics is checked."""
Names = Annotated[tuple[Text, ...], msgspec.Meta(min_length=1, extra={"read": "names"})]
"""Different names, at least one."""
Plugin = Annotated[str, msgspec.Meta(extra={"read": "plugin"})]
"""A class of your own, `module:Class`; keys that are not declared then are its parameters."""
Own = Annotated[dict[str, Any], msgspec.Meta(extra={"read": "own"})]
"""Collects the parameters of a class of your own."""


def _per(item: object) -> msgspec.Meta:
    return msgspec.Meta(extra={"read": "per_name", "item": item})


PerJoint = Annotated[PerName, _per(Finite)]
"""One number for all of `joints`, a list of one each, or a map by joint."""
NonNegativePerJoint = Annotated[PerName, _per(NonNegative)]
"""As `PerJoint`, none of the numbers negative."""
PositivePerJoint = Annotated[PerName, _per(Positive)]
"""As `PerJoint`, each number above 0."""


UNITS_NS = {
    "ns": 1,
    "us": 10**3,
    "µs": 10**3,  # MICRO SIGN
    "μs": 10**3,  # GREEK SMALL LETTER MU
    "ms": 10**6,
    "s": 10**9,
    "min": 60 * 10**9,
    "h": 3600 * 10**9,
}
LONGEST_NS = 2**63 - 1
"""What fits a signed 64-bit integer, as MCAP and other languages keep time: 292 years."""

_FORM = re.compile(r"([0-9]{1,19}(?:\.[0-9]{1,19})?)(?:/([0-9]{1,19}))? *([a-zµμ]+)")
_RATE = re.compile(r"([0-9]+(?:\.[0-9]+)?) *(hz|khz)", re.IGNORECASE)
_HERTZ = {"hz": 1, "khz": 1000}
_WRITTEN = ("s", "ms", "us", "ns")


def parse_duration(text: str) -> int:
    """Return a duration such as `5ms`, `0.005s` or `1/200s` in [ns].

    Raises WiringError when it has no unit, is not positive, is longer than 292 years, or is no
    whole number of nanoseconds, then with the nearest one that is.
    """
    form = _FORM.fullmatch(text.strip())
    rate = _RATE.fullmatch(text.strip())
    if rate is not None and float(rate[1]) > 0:
        hertz = float(rate[1]) * _HERTZ[rate[2].lower()]
        period = f"{1 / hertz:.9g}s" if hertz < 1 else f"1/{hertz:.9g}s"
        raise WiringError(f"{text!r} is a rate, not a duration; write its period, {period}")
    if form is None or form[3] not in UNITS_NS:
        raise WiringError(
            f"{text!r} is no duration; write a number and one of the units ns, us, ms, s, min, h, "
            "e.g. 5ms"
        )
    if form[2] is not None and int(form[2]) == 0:
        raise WiringError(f"{text!r} divides by zero")
    exact = Fraction(form[1]) / int(form[2] or 1) * UNITS_NS[form[3]]
    if exact > LONGEST_NS:
        raise WiringError(f"{text!r} is longer than 2^63 − 1 ns (292 years)")
    if exact.denominator != 1:
        nearest = format_duration(max(1, round(exact)))
        raise WiringError(
            f"{text!r} is {float(exact):.16g} ns, not a whole number of nanoseconds; "
            f"the nearest is {nearest}"
        )
    if exact == 0:
        raise WiringError(f"{text!r} must be longer than 0")
    return int(exact)


def whole_steps(text: str, step_ns: int) -> int:
    """Return how many steps a duration such as `5ms` is; step_ns: their length [ns].

    Raises WiringError when it is no duration, or no whole number of steps: with the nearest.
    """
    time_ns = parse_duration(text)
    steps, rest = divmod(time_ns, step_ns)
    if rest:
        near = [n * step_ns for n in (steps, steps + 1) if 0 < n * step_ns <= LONGEST_NS]
        raise WiringError(
            f"{text} is {time_ns / step_ns:.6g} steps of "
            f"{format_duration(step_ns)}, not a whole number; the nearest is "
            f"{' or '.join(map(format_duration, near))}"
        )
    return steps


def format_duration(duration_ns: int) -> str:
    """Return a duration in the largest of s, ms, us and ns that makes it a whole number."""
    unit = next(unit for unit in _WRITTEN if duration_ns % UNITS_NS[unit] == 0)
    return f"{duration_ns // UNITS_NS[unit]}{unit}"
