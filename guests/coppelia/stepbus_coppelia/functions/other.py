"""Signals, tables, drawing, scripts: what is about no object of the world."""

from typing import TYPE_CHECKING, Any

import cbor2

from stepbus_coppelia.clients import ApiError

from .table import CONSTANTS, FUNCTIONS, function, number

if TYPE_CHECKING:
    from stepbus_coppelia.session import Session

_GROUP = "other"
_SCRIPT = 1_010_000
"""Handle of the one script that functions are called of."""


# --- signals and data ----------------------------------------------------------------------------


def _add_signals() -> None:
    """Add `setFloatSignal`, `getFloatSignal`, `clearFloatSignal` and the like."""
    kinds = {"Int32": int, "Integer": int, "Float": float, "Double": float, "String": None}
    for kind, convert in kinds.items():
        store = "Int32" if convert is int else "Float" if convert is float else "String"

        def put(sim: "Session", name: str, value: Any, _to: Any = convert, _in: str = store) -> int:
            sim.signals[f"{_in} {name}"] = value if _to is None else _to(number(value))
            return 1

        def get(sim: "Session", name: str, _in: str = store) -> Any:
            value = sim.signals.get(f"{_in} {name}")
            return value.decode(errors="replace") if isinstance(value, bytes) else value

        def clear(sim: "Session", name: str, _in: str = store) -> None:
            sim.signals.pop(f"{_in} {name}", None)

        texts = ("Sets a signal.", "Returns a signal; nothing where it is not set.", "Clears it.")
        for work, verb, text in zip((put, get, clear), ("set", "get", "clear"), texts, strict=True):
            work.__name__, work.__doc__ = f"{verb}{kind}Signal", text
            function("signals")(work)


_add_signals()


@function("signals", "writeCustomStringData", "writeCustomTableData")
def write_custom_data_block(sim: "Session", handle: int, tag: str, data: Any) -> None:
    """Keep data with an object, or with the scene."""
    store = sim.signals if handle < 0 else sim.scene.get(handle).values
    store[f"data {tag}"] = data


@function("signals", "readCustomStringData", "readCustomTableData")
def read_custom_data_block(sim: "Session", handle: int, tag: str, *_more: Any) -> tuple[Any]:
    """Return data that was kept; nothing where there is none."""
    store = sim.signals if handle < 0 else sim.scene.get(handle).values
    return (store.get(f"data {tag}"),)


@function("buffers")
def pack_table(_sim: "Session", table: Any, _scheme: int = 0) -> bytes:
    """Return a table as a buffer, in CBOR."""
    return cbor2.dumps(table)


@function("buffers")
def unpack_table(_sim: "Session", data: bytes) -> tuple[Any]:
    """Return the table of a buffer of `packTable`."""
    try:
        return (cbor2.loads(data),)
    except (cbor2.CBORDecodeError, ValueError) as exc:
        raise ApiError(f"this is no table that `packTable` has packed: {exc}") from exc


# --- time ----------------------------------------------------------------------------------------


@function("simulation")
def wait(sim: "Session", seconds: float, is_simulated: bool = True) -> float:
    """Return when so much simulation time has passed [s]."""
    if sim.client is not None and sim.is_running and is_simulated:
        sim.client.until = sim.time + number(seconds)
        sim.client.waits = True
    return 0.0


# --- drawing -------------------------------------------------------------------------------------


@function("drawing")
def add_drawing_object(
    sim: "Session", form: int, size: float, _tolerance: float, parent: int, most: int, *more: Any
) -> int:
    """Make an object that is drawn: points, lines and the like, in a colour."""
    colours = [row for row in more if isinstance(row, list | tuple) and len(row) >= 3]
    frame = "" if parent == -1 else sim.scene.get(parent).name
    return sim.drawings.add(
        int(form), number(size), frame, int(most), colours[0] if colours else None
    )


@function("drawing")
def add_drawing_object_item(sim: "Session", handle: int, item: Any) -> int:
    """Add an item to it: x, y, z of a point, or of both ends of a line; nothing: clears it."""
    is_clearing = bool(int(handle) & CONSTANTS["handleflag_setmultiple"]) if handle > 0 else False
    sim.drawings.draw(int(handle), None if is_clearing else item)
    return 1


@function("drawing")
def remove_drawing_object(sim: "Session", handle: int) -> int:
    """Remove it."""
    sim.drawings.remove(int(handle))
    return 1


# --- scripts -------------------------------------------------------------------------------------


@function(_GROUP, "getScriptHandle")
def get_script(_sim: "Session", *_arguments: Any) -> int:
    """Return a handle for `callScriptFunction`, the same for every script."""
    return _SCRIPT


@function(_GROUP)
def call_script_function(sim: "Session", name: str, _script: Any = None, *arguments: Any) -> Any:
    """Call a function of the class that `functions` of the gateway names, instead of one in Lua."""
    if not isinstance(name, str):
        name = _script
    own = str(name).partition("@")[0]
    work = getattr(sim.functions, own, None) if not own.startswith("_") else None
    if not callable(work):
        raise ApiError(
            f"script function {own!r} is in Lua; write it in Python, as a method of the class that "
            "`functions` of the gateway names."
        )
    return work(*arguments)


@function(_GROUP, "getApiFunc")
def get_api_info(_sim: "Session", *_arguments: Any) -> list[str]:
    """Return the names of the functions."""
    return [f"sim.{name}" for name in FUNCTIONS]
