"""The state of a participant at a checkpoint: how its objects differ from those after `start`.

A state maps numbers of objects to rows: the kind of an object, and what it has. Objects that are
there after `start` keep their numbers, and have rows only where they have changed; so models, which
nothing changes, are not part of it. A value in a row is as in MessagePack, or a list that says what
it is, such as `["ref", number of an object]`.
"""

import copy
import functools
import importlib
import json
import math
import zlib
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping
from enum import Enum
from pathlib import Path
from types import FunctionType, MethodType
from typing import Any

import msgspec
import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel, SelfCollisions
from stepbus_participant import Config, Participant, warn
from stepbus_schemas import Message, RunError

_PLAIN = frozenset((type(None), bool, int, float, str, bytes))
_CONSTANT = (Config, RobotModel, SelfCollisions)
"""What no step changes; RobotModel: apart from the load that it carries."""

_OURS = {"stepbus_store", "stepbus_schemas", "stepbus_kinematics"}
"""Packages whose classes and functions a state may name."""

_encode = msgspec.msgpack.encode


class _Unsaved(Exception):
    """Something that a state cannot have."""


class _Objects:
    """Numbers objects in the order in which they are found, and describes each by a row.

    first: the objects after `start`, which have their numbers; None: these are they. constant: what
    no step changes. rows: number of an object → its row in MessagePack.
    """

    def __init__(self, constant: Collection[Any], first: "_Objects | None" = None) -> None:
        self.objects: list[Any] = [] if first is None else list(first.objects)
        self.rows: dict[int, msgspec.Raw] = {}
        self._numbers = {id(x): number for number, x in enumerate(self.objects)}
        self._constant = set(map(id, constant))
        self._known = math.inf if first is None else len(self.objects)
        self._waiting: deque[int] = deque()

    def describe(self, root: Any) -> None:
        """Describe an object, and all that it refers to; raises _Unsaved."""
        self._refer(root)
        while self._waiting:
            number = self._waiting.popleft()
            row = self._row(self.objects[number])
            if row is None and number >= self._known:
                raise _Unsaved(f"{type(self.objects[number]).__qualname__} cannot be saved")
            self.rows[number] = msgspec.Raw(_encode(row))

    def _refer(self, x: Any) -> list[Any]:
        number = self._numbers.get(id(x))
        if number is None:
            number = self._numbers[id(x)] = len(self.objects)
            self.objects.append(x)
        if number not in self.rows:
            self.rows[number] = msgspec.Raw()
            self._waiting.append(number)
        return ["ref", number]

    def _value(self, x: Any) -> Any:
        """Return what stands for a value in a row."""
        kind = type(x)
        if kind in _PLAIN:
            return x
        if kind is tuple:
            return ["tuple", self._values(x)]
        if kind in _ROWS:
            return self._refer(x)
        for base, made in _VALUES:
            if isinstance(x, base):
                return made(self, x)
        return self._refer(x)

    def _values(self, items: Iterable[Any]) -> list[Any]:
        return [x if type(x) in _PLAIN else self._value(x) for x in items]

    def _sorted(self, items: Iterable[Any]) -> list[Any]:
        return sorted(map(self._value, items), key=_encode)

    def _named(self, items: Mapping[str, Any]) -> dict[str, Any]:
        return dict(zip(items, self._values(items.values()), strict=True))

    def _pairs(self, items: Mapping[Any, Any]) -> list[Any]:
        return [self._values(items), self._values(items.values())]

    def _function(self, x: Any) -> Any:
        return self._refer(x) if "<" in x.__qualname__ else ["name", _name(x)]

    def _row(self, x: Any) -> Any:
        """Return what an object has; None: it is a constant, or not known."""
        kind = type(x)
        if isinstance(x, _CONSTANT) or id(x) in self._constant:
            return None
        row = _ROWS.get(kind)
        if row is not None:
            return row(self, x)
        if isinstance(x, Message):
            return ["message", _name(kind), _encode(x)]
        return self._object(x) if _is_ours(kind) else None

    def _object(self, x: Any) -> list[Any]:
        kind = type(x)
        if hasattr(x, "made_from"):
            return ["made", _name(kind), self._value(x.made_from)]
        if isinstance(x, msgspec.Struct):
            return ["struct", _name(kind), self._named(msgspec.structs.asdict(x))]
        return ["object", _name(kind), self._named(_fields(x))]

    def _array(self, x: Any) -> Any:
        order = "C" if x.flags.c_contiguous else "F"
        return ["array", x.dtype.str, x.shape, order, x.tobytes(order)]

    def _random(self, x: Any) -> Any:
        is_new = self._numbers[id(x)] >= self._known
        return None if is_new else ["random", json.dumps(x.bit_generator.state)]


_VALUES: tuple[tuple[Any, Callable[[_Objects, Any], Any]], ...] = (
    (frozenset, lambda to, x: ["frozenset", to._sorted(x)]),
    (MethodType, lambda to, x: ["method", to._value(x.__self__), x.__name__]),
    (Enum, lambda _, x: ["enum", _name(type(x)), x.value]),
    (np.generic, lambda _, x: ["scalar", x.dtype.str, x.tobytes()]),
    (Path, lambda _, x: ["path", str(x)]),
    (tuple, lambda to, x: ["named", _name(type(x)), to._values(x)]),
    (FunctionType | type, _Objects._function),
)
"""What stands for a value of these types, and of their subclasses."""

_ROWS: Mapping[type, Callable[[_Objects, Any], Any]] = {
    list: lambda to, x: ["list", to._values(x)],
    dict: lambda to, x: ["dict", *to._pairs(x)],
    Counter: lambda to, x: ["counter", *to._pairs(x)],
    set: lambda to, x: ["set", to._sorted(x)],
    deque: lambda to, x: ["deque", x.maxlen, to._values(x)],
    type(iter([])): lambda to, x: ["iterator", to._values(copy.copy(x))],
    np.ndarray: _Objects._array,
    pin.SE3: lambda _, x: ["pose", x.rotation.tobytes("C"), x.translation.tobytes()],
    np.random.Generator: _Objects._random,
    functools.partial: lambda to, x: [
        "partial",
        to._value(x.func),
        to._values(x.args),
        to._named(x.keywords),
    ],
}


@functools.cache
def _slots(kind: type) -> list[str]:
    return [name for base in kind.__mro__ for name in getattr(base, "__slots__", ())]


def _fields(x: Any) -> dict[str, Any]:
    kind: Any = type(x)
    fields = {name: getattr(x, name) for name in _slots(kind) if hasattr(x, name)}
    fields.update(getattr(x, "__dict__", {}))
    return {name: item for name, item in fields.items() if type(item) is not _Objects}


def _name(x: Any) -> str:
    return f"{x.__module__}:{x.__qualname__}"


def _is_ours(x: Any) -> bool:
    return x.__module__.partition(".")[0] in _OURS


def _named(name: str) -> Any:
    """Return what `_name` names; raises RunError for what is none of ours."""
    module, _, path = name.partition(":")
    if module.partition(".")[0] in _OURS:
        found: Any = functools.reduce(getattr, path.split("."), importlib.import_module(module))
        if isinstance(found, FunctionType | type) and _name(found) == name:
            return found
    raise RunError(f"the state names {name}")


class _Restored:
    """The objects of a state: those that are there get what they had, the others are made."""

    def __init__(self, objects: Iterable[Any], rows: Mapping[int, Any]) -> None:
        self._objects = dict(enumerate(objects))
        self._rows = rows
        self._empty = [number for number in rows if number in self._objects]
        self._last: list[tuple[Any, list[Any]]] = []
        while self._empty:
            number = self._empty.pop()
            kind, *row = rows[number]
            if kind not in _FILL:
                raise RunError(f"the state changes a constant {kind}")
            _FILL[kind](self, self._objects[number], *row)
        for x, given in self._last:
            x.__init__(*given)

    def _object(self, number: int) -> Any:
        if number not in self._objects:
            kind, *row = self._rows[number]
            self._objects[number] = _MAKE[kind](self, *row)
            if kind in _FILL and kind != "array":
                self._empty.append(number)
        return self._objects[number]

    def value(self, x: Any) -> Any:
        """Return the value that something in a row stands for."""
        return _READ[x[0]](self, *x[1:]) if isinstance(x, list) else x

    def values(self, items: Iterable[Any]) -> list[Any]:
        return list(map(self.value, items))

    def named(self, items: Mapping[str, Any]) -> dict[str, Any]:
        return {name: self.value(item) for name, item in items.items()}

    def set_fields(self, x: Any, kind: str, fields: Mapping[str, Any]) -> None:
        """Give an object its fields, and no others; raises RunError for one of another class."""
        if kind != _name(type(x)):
            raise RunError(f"the state has {kind} in place of {_name(type(x))}")
        for name in _fields(x).keys() - fields.keys():
            object.__delattr__(x, name)
        for name, item in fields.items():
            object.__setattr__(x, name, self.value(item))

    def set_items(self, x: Any, *items: Any) -> None:
        x.clear()
        rows = self.values(items[-1])
        if isinstance(x, dict):
            dict.update(x, zip(self.values(items[0]), rows, strict=True))
        else:
            (x.update if isinstance(x, set) else x.extend)(rows)

    def set_array(self, x: Any, dtype: str, shape: list[int], order: Any, data: bytes) -> None:
        x[...] = np.ndarray(shape, dtype, data, order=order)

    def set_random(self, x: Any, state: str) -> None:
        x.bit_generator.state = json.loads(state)

    def make_later(self, x: Any, _: str, given: Any) -> None:
        """Make an object again, once all is there that it is made from."""
        self._last.append((x, self.value(given)))


_READ: Mapping[str, Callable[..., Any]] = {
    "ref": lambda _, number: _._object(number),
    "tuple": lambda of, items: tuple(of.values(items)),
    "named": lambda of, name, items: _named(name)(*of.values(items)),
    "frozenset": lambda of, items: frozenset(of.values(items)),
    "enum": lambda _, name, value: _named(name)(value),
    "path": lambda _, text: Path(text),
    "scalar": lambda _, dtype, data: np.frombuffer(data, dtype)[0],
    "method": lambda of, owner, name: getattr(of.value(owner), name),
    "name": lambda _, name: _named(name),
}
_MAKE: Mapping[str, Callable[..., Any]] = {
    "list": lambda *_: [],
    "dict": lambda *_: {},
    "counter": lambda *_: Counter(),
    "set": lambda *_: set(),
    "deque": lambda _, most, __: deque(maxlen=most),
    "object": lambda _, name, __: object.__new__(_named(name)),
    "made": lambda _, name, __: object.__new__(_named(name)),
    "iterator": lambda of, items: iter(of.values(items)),
    "message": lambda _, name, data: msgspec.msgpack.decode(data, type=_named(name)),
    "struct": lambda of, name, fields: _named(name)(**of.named(fields)),
    "array": lambda _, dtype, shape, order, data: np.ndarray(shape, dtype, data, order=order).copy(
        order
    ),
    "pose": lambda _, rotation, translation: pin.SE3(
        np.frombuffer(rotation).reshape(3, 3), np.frombuffer(translation)
    ),
    "partial": lambda of, function, items, named: functools.partial(
        of.value(function), *of.values(items), **of.named(named)
    ),
}
_FILL: Mapping[str, Callable[..., None]] = {
    **dict.fromkeys(("list", "dict", "counter", "set", "deque"), _Restored.set_items),
    "object": _Restored.set_fields,
    "made": _Restored.make_later,
    "array": _Restored.set_array,
    "random": _Restored.set_random,
}


class Remembering(Participant):
    """A participant that saves all that has changed since its `start`, which ends with `remember`.

    That may be objects of our classes and of NumPy, containers, poses and messages. An object that
    has others keeps the arguments that it is made from, as `made_from`, and is made again. What is
    of other types after `start` must not change. A subclass elsewhere saves nothing.
    """

    _reasons: frozenset[str] = frozenset()

    def remember(self, *constant: Any) -> None:
        """Take all that there is now as what every start makes; constant: what no step changes."""
        self._constant = constant
        self._first = _Objects(constant)
        self._first.describe(self)

    def save(self) -> bytes | None:
        """Return how all objects differ from those after `start`; None if it cannot be said."""
        if not _is_ours(type(self)):
            return None
        now = _Objects(self._constant, self._first)
        try:
            now.describe(self)
        except _Unsaved as exc:
            # A run does not end for want of a checkpoint.
            if str(exc) not in self._reasons:
                self._reasons |= {str(exc)}
                warn(f"no checkpoint: {exc}")
            return None
        first = self._first.rows
        changed = {n: row for n, row in now.rows.items() if row != first.get(n)}
        return zlib.compress(_encode(changed), 1)

    def restore(self, state: bytes) -> None:
        """Change all objects as `save` has found them."""
        _Restored(self._first.objects, msgspec.msgpack.decode(zlib.decompress(state)))

    def close(self) -> None:
        """Let go of all objects: they refer to each other, and a command ends without a search."""
        self._first, self._constant = _Objects(()), ()
        super().close()
