"""The types of goods that a shop has, read from a world file."""

from pathlib import Path

from stepbus_participant import SettingsError, parameters


def types_in(path: Path) -> list[str]:
    """Return the keys of `stock.types` of a world file.

    Raises ValueError with a sentence for a file without any, or one that cannot be read.
    """
    try:
        data = parameters.read_yaml(path, "a world has at least bodies").data
    except SettingsError as exc:
        raise ValueError(str(exc)) from exc
    stock = data.get("stock")
    types = stock.get("types") if isinstance(stock, dict) else None
    if not isinstance(types, dict) or not types:
        raise ValueError(f"{path.name} has no stock.types")
    return list(types)
