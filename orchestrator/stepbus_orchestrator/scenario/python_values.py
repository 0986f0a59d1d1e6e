"""Values of a scenario as Python writes them: overrides `{"controller.params.kp": 80}`, maps."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

from stepbus_schemas import Message, type_name

Overrides = Mapping[str, Any] | Sequence[str]
"""Path → value, or texts such as `controller.params.kp=80`."""


def override_texts(given: Overrides) -> list[str]:
    """Return overrides as the command line writes them: `path=YAML`."""
    if isinstance(given, Mapping):
        return [f"{path}={yaml_text(value)}" for path, value in given.items()]
    return list(given)


def plain_value(value: Any) -> Any:
    """Return a value as YAML has it: message classes by name, NumPy values and paths as plain ones.

    Anything else is returned as it is.
    """
    if isinstance(value, type) and issubclass(value, Message):
        return type_name(value)
    if isinstance(value, PathLike):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(item) for item in value]
    return value


def yaml_text(value: Any) -> str:
    """Return a value as one line of YAML that reads back as the same value."""
    value = plain_value(value)
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    if isinstance(value, list):
        return f"[{', '.join(map(yaml_text, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{json.dumps(k)}: {yaml_text(v)}' for k, v in value.items())}}}"
    return json.dumps(value)
