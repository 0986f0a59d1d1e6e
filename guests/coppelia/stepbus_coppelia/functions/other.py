"""Signals, buffers, drawing, scripts: what is about no object of the world."""

import struct
from typing import Any

import cbor2

from stepbus_coppelia.clients import ApiError

from .table import CONSTANTS, Group, number

_CLEAR = CONSTANTS["handleflag_setmultiple"]


class Signals(Group):
    """Values by name."""

    title = "signals"
    also = {
        "setIntegerSignal": "setInt32Signal",
        "setDoubleSignal": "setFloatSignal",
        "setBufferSignal": "setStringSignal",
        **{f"get{k}Signal": "getInt32Signal" for k in ("Integer", "Float", "Double", "Buffer")},
        "clearIntegerSignal": "clearInt32Signal",
        **{f"clear{k}Signal": "clearInt32Signal" for k in ("Float", "Double", "String", "Buffer")},
    }

    def setInt32Signal(self, name: str, value: Any) -> int:
        """Set a signal."""
        self.sim.signals[name] = int(number(value))
        return 1

    def setFloatSignal(self, name: str, value: Any) -> int:
        """Set a signal."""
        self.sim.signals[name] = number(value)
        return 1

    def setStringSignal(self, name: str, value: Any) -> int:
        """Set a signal."""
        self.sim.signals[name] = value
        return 1

    def getInt32Signal(self, name: str) -> Any:
        """Return a signal; nothing where it is not set."""
        return self.sim.signals.get(name)

    def getStringSignal(self, name: str) -> Any:
        """Return a signal as text; nothing where it is not set."""
        value = self.sim.signals.get(name)
        return value.decode(errors="replace") if isinstance(value, bytes) else value

    def clearInt32Signal(self, name: Any = None) -> int:
        """Clear a signal, or all of them; return how many."""
        names = list(self.sim.signals) if name is None else [name]
        return sum(self.sim.signals.pop(own, None) is not None for own in names)


class Other(Group):
    """Buffers, drawing objects, and functions of other scripts."""

    title = "buffers, drawing and scripts"
    also = {"getScriptHandle": "getScript"}

    def packTable(self, table: Any, _scheme: int = 0) -> bytes:
        """Return a table as a buffer, in CBOR."""
        return cbor2.dumps(table)

    def unpackTable(self, data: bytes) -> Any:
        """Return the table of a buffer of `packTable`."""
        try:
            return cbor2.loads(data)
        except (cbor2.CBORDecodeError, ValueError) as exc:
            raise ApiError(f"this is no table that `packTable` has packed: {exc}") from exc

    def packFloatTable(self, values: Any, start: int = 0, count: int = 0) -> bytes:
        """Return numbers as a buffer."""
        rows = values[start : start + count] if count else values[start:]
        return struct.pack(f"<{len(rows)}f", *rows)

    def unpackFloatTable(self, data: bytes, start: int = 0, count: int = 0, skip: int = 0) -> Any:
        """Return the numbers of a buffer, from one of them on, behind some bytes."""
        rest = data[skip + 4 * start :]
        count = count or len(rest) // 4
        return list(struct.unpack(f"<{count}f", rest[: 4 * count]))

    def addDrawingObject(
        self, form: int, size: float, _tolerance: float, parent: int, most: int, *more: Any
    ) -> int:
        """Make an object that is drawn, in a colour: points, lines and the like."""
        colours = [row for row in more if isinstance(row, list | tuple) and len(row) >= 3]
        frame = "" if parent == -1 else self.sim.scene.get(parent).name
        colour = list(colours[0]) if colours else None
        return self.sim.drawings.add(int(form), number(size), frame, int(most or 1000), colour)

    def addDrawingObjectItem(self, handle: int, item: Any = None) -> int:
        """Add x, y, z of a point, or of both ends of a line; nothing: clear it."""
        point = None if int(handle) & _CLEAR else item or None
        self.sim.drawings.draw(int(handle) & ~_CLEAR, point)
        return 1

    def removeDrawingObject(self, handle: int) -> None:
        """Remove it; `handle_all`: remove all."""
        self.sim.drawings.remove(int(handle))

    def getScript(self, *_arguments: Any) -> int:
        """Return a handle for `callScriptFunction`, the same for every script."""
        return 1_010_000

    def callScriptFunction(self, name: Any, script: Any = None, *arguments: Any) -> Any:
        """Call a function of the class that `functions` of the gateway names, not one in Lua."""
        own = str(name if isinstance(name, str) else script).partition("@")[0]
        if own.startswith("_") or not callable(work := getattr(self.sim.lua, own, None)):
            raise ApiError(
                f"script function {own!r} is in Lua; write it in Python, as a method of the class "
                "that `functions` of the gateway names."
            )
        return work(*arguments)
