"""`Settings`: parameters declared once, as a class with types, bounds, defaults and descriptions.

    class Params(Settings):
        \"\"\"Parameters of my controller.\"\"\"

        joints: Names
        \"\"\"Joints under control, in the order of every vector.\"\"\"
        kp: PerJoint = each(100.0)
        \"\"\"Proportional gain [N·m/rad].\"\"\"

From it come the reading with all problems at once (`read.py`), the tables of the documentation
and the JSON Schema for editors (`scripts/parameter_docs.py`). docs/reference/parameters.md is the
guide.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Self, dataclass_transform

import msgspec

from .problems import Keys, Problems
from .read import read

__all__ = ["Settings"]


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
    """A set of parameters, with one field per key; `read.py` of this package documents the checks.

    short: key that gets the value if the scenario has a string instead of a map. kinds: a tagged
    union: a key, and value of that key → the subclass with its further keys, such as
    `("law", {"pid": PIDParams})`; other values have no further keys.
    """

    short: ClassVar[str] = ""
    kinds: ClassVar[tuple[str, Mapping[str, type[Any]]]] = ("", {})

    @classmethod
    def elsewhere(cls, key: str) -> str:  # noqa: ARG003
        """Return where an unknown key belongs; empty: nowhere."""
        return ""

    def problems(self) -> Iterable[tuple[Keys, str]]:
        """Yield problems of valid values that do not fit together: keys and a message."""
        return ()

    def file_problems(self) -> Iterable[tuple[Keys, str]]:
        """Yield problems in files, for `stepbus validate`; called if there are no others."""
        return ()

    @classmethod
    def of(cls, data: Mapping[str, Any], folder: Path | None = None) -> Self:
        """Return plain data as an instance of this class.

        folder: base of relative file names; None: files are not checked. Raises SettingsError that
        lists every problem.
        """
        problems = Problems()
        settings = read(cls, data, problems, folder=folder)
        problems.refuse()
        return settings
