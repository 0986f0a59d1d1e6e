"""Variants of a branch: every value of what is varied, each with those of all others."""

import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

_MOST = 100
_UNFIT = re.compile(r"[^A-Za-z0-9._=+-]+")


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One variant. name: `kp=50`, or `kp=50, kd=2`. folder: a name for its folder."""

    name: str
    overrides: Sequence[str]

    @property
    def folder(self) -> str:
        """Return its name without what a folder's should not have."""
        return _UNFIT.sub("_", self.name.replace(", ", ","))


def variants(texts: Sequence[str]) -> list[Variant]:
    """Return the variants of texts such as `controller.params.kp=50,100,200`.

    Raises WiringError for one that names no values, or where they are too many together.
    """
    rows = [_values(text) for text in texts]
    found = [
        Variant(
            name=", ".join(f"{path.rpartition('.')[2]}={value}" for path, value in chosen),
            overrides=[f"{path}={value}" for path, value in chosen],
        )
        for chosen in itertools.islice(itertools.product(*rows), _MOST + 1)
    ]
    if len(found) > _MOST:
        raise WiringError(f"--vary: more than {_MOST} variants")
    if len({variant.folder for variant in found}) < len(found):
        raise WiringError("--vary: two variants are the same")
    return found


def _values(text: str) -> list[tuple[str, str]]:
    path, _, values = text.partition("=")
    # As YAML has a list, so that a value may be one itself.
    found = parse_yaml(text, f"[{values}]") if path.strip() and values.strip() else []
    if not found:
        raise WiringError(
            f"--vary {text!r}: write PATH=VALUE,VALUE…, e.g. controller.params.kp=50,100"
        )
    return [(path.strip(), json.dumps(value, ensure_ascii=False)) for value in found]
