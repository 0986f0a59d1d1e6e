"""Import public names on first use (PEP 562)."""

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any


def imported_on_use(
    module: str, names: Sequence[str], homes: Sequence[str], modules: Sequence[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a module.

    names: public names. homes: modules that are searched for a name, in order; the search stops at
    the first that has it. modules: the names that are submodules. A name whose extra is not
    installed raises ExtraMissing.
    """

    def find(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        if name in modules:
            return import_module(f"{module}.{name}")
        loaded = (import_module(home, "stepbus") for home in homes)
        try:
            value = next(getattr(home, name) for home in loaded if hasattr(home, name))
        except ModuleNotFoundError as exc:
            from stepbus_participant import ExtraMissing, extra_hint, lacks  # noqa: PLC0415

            if not extra_hint(exc.name or ""):
                raise
            raise ExtraMissing(lacks(f"{module}.{name}", str(exc.name))) from None
        setattr(sys.modules[module], name, value)
        return value

    def list_names() -> list[str]:
        own = (name for name in vars(sys.modules[module]) if name.startswith("__"))
        return [*names, *own]

    return find, list_names
