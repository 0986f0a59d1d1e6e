"""The state of a participant at a checkpoint: how its objects differ from those after `start`.

A state is a list of rows: number of an object, its kind, and what it has. Objects that are there
after `start` keep their numbers, and have rows only if they have changed; so models, which nothing
changes, are not part of it. Values in a row are as in MessagePack; a list is what `_value` makes of others.
"""

import copy
import functools
import importlib
import json
import math
from collections import Counter, deque
from collections.abc import Collection, Iterable, Mapping
from enum import Enum
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
_ListIterator = type(iter([]))
_NOT_YET = msgspec.Raw()
_WHOLE = {"message", "array", "pose", "partial", "iterator", "struct"}
"""Kinds of rows that objects are made of at once; the others are filled later."""

_EMPTY: Mapping[str, Any] = {"list": list, "dict": dict, "counter": Counter, "set": set}


class _Unsaved(Exception):
    """Something that a state cannot have."""


class _Objects:
    """Numbers objects in the order in which they are found, and describes each by a row.

    first: the objects after `start`, which have their numbers; None: these are they. constant: what
    no step changes. rows: number of an object → its row in MessagePack.
    """

    def __init__(self, constant: Collection[Any], first: "_Objects | None" = None) -> None:
        self.objects: list[Any] = [] if first is None else list(first.objects)
        self._numbers = {id(x): number for number, x in enumerate(self.objects)}
        self._constant = set(map(id, constant))
        self._known = None if first is None else len(self.objects)
        self._waiting: deque[int] = deque()
        self.rows: dict[int, msgspec.Raw] = {}

    def describe(self, root: Any) -> None:
        """Describe an object, and all that it refers to; raises _Unsaved."""
        self._reference(root)
        while self._waiting:
            number = self._waiting.popleft()
            row = self._row(self.objects[number])
            if row is None and self._known is not None and number >= self._known:
                raise _Unsaved(f"{type(self.objects[number]).__qualname__} cannot be saved")
            self.rows[number] = msgspec.Raw(_encode(row))

    def _reference(self, x: Any) -> list[Any]:
        number = self._numbers.get(id(x))
        if number is None:
            number = self._numbers[id(x)] = len(self.objects)
            self.objects.append(x)
        if number not in self.rows:
            self.rows[number] = _NOT_YET
            self._waiting.append(number)
        return ["ref", number]

    def _value(self, x: Any) -> Any:
        """Return what stands for a value in a row."""
        kind = type(x)
        if kind in _PLAIN:
            return x
        if kind is tuple:
            return ["tuple", [self._value(item) for item in x]]
        if isinstance(x, Enum):
            return ["enum", _name(kind), x.value]
        if isinstance(x, np.generic):
            return ["scalar", x.dtype.str, x.tobytes()]
        if isinstance(x, tuple):
            return ["named", _name(kind), [self._value(item) for item in x]]
        if kind is frozenset:
            return ["frozenset", self._sorted(x)]
        if kind is MethodType:
            return ["method", self._value(x.__self__), x.__name__]
        if isinstance(x, FunctionType | type) and "<" not in x.__qualname__:
            return ["name", _name(x)]
        return self._reference(x)

    def _sorted(self, items: Iterable[Any]) -> list[Any]:
        return sorted(map(self._value, items), key=_encode)

    def _row(self, x: Any) -> Any:
        """Return what an object has; None: a constant."""
        kind = type(x)
        if isinstance(x, _CONSTANT) or id(x) in self._constant:
            return None
        if isinstance(x, Message):
            return ["message", _name(kind), _encode(x)]
        if kind is list:
            return ["list", [self._value(item) for item in x]]
        if kind is dict or kind is Counter:
            rows = [(self._value(key), self._value(item)) for key, item in x.items()]
            return ["dict" if kind is dict else "counter", rows]
        if kind is np.ndarray and not x.dtype.hasobject:
            order = "C" if x.flags.c_contiguous else "F"
            return ["array", x.dtype.str, x.shape, order, x.tobytes(order)]
        if kind is set:
            return ["set", self._sorted(x)]
        if kind is deque:
            return ["deque", x.maxlen, [self._value(item) for item in x]]
        if kind is _ListIterator:
            return ["iterator", [self._value(item) for item in copy.copy(x)]]
        if kind is pin.SE3:
            return ["pose", x.rotation.tobytes(), x.translation.tobytes()]
        if kind is np.random.Generator and self._numbers[id(x)] < (self._known or math.inf):
            return ["random", json.dumps(x.bit_generator.state)]
        if kind is functools.partial:
            named = {key: self._value(item) for key, item in x.keywords.items()}
            return ["partial", self._value(x.func), self._value(x.args), named]
        if kind.__module__.partition(".")[0] in _OURS and kind is not FunctionType:
            if "__getstate__" in kind.__dict__:
                return ["made", _name(kind), self._value(x.__getstate__())]
            fields = {key: self._value(item) for key, item in _fields(x).items()}
            return ["struct" if isinstance(x, msgspec.Struct) else "object", _name(kind), fields]
        return None


def _fields(x: Any) -> dict[str, Any]:
    if isinstance(x, msgspec.Struct):
        return msgspec.structs.asdict(x)
    slots = [name for kind in type(x).__mro__ for name in getattr(kind, "__slots__", ())]
    fields = {name: getattr(x, name) for name in slots if hasattr(x, name)}
    fields.update(getattr(x, "__dict__", {}))
    return {name: item for name, item in fields.items() if type(item) is not _Objects}


def _name(x: Any) -> str:
    return f"{x.__module__}:{x.__qualname__}"


def _named(name: str) -> Any:
    """Return what `_name` names; raises RunError for what is none of ours."""
    module, _, path = name.partition(":")
    if module.partition(".")[0] not in _OURS:
        raise RunError(f"the state names {name}")
    return functools.reduce(getattr, path.split("."), importlib.import_module(module))


class _Restored:
    """The objects of a state: those that are there get what they had, the others are made."""

    def __init__(self, objects: Iterable[Any], rows: Mapping[int, Any]) -> None:
        self._objects = dict(enumerate(objects))
        self._rows = rows
        self._unfilled = [number for number in rows if number in self._objects]
        while self._unfilled:
            number = self._unfilled.pop()
            self._fill(self._objects[number], rows[number])

    def _object(self, number: int) -> Any:
        if number not in self._objects:
            row = self._rows[number]
            self._objects[number] = self._made(row)
            if row[0] not in _WHOLE:
                self._unfilled.append(number)
        return self._objects[number]

    def _made(self, row: Any) -> Any:
        """Return an object; one that may refer to itself is still empty."""
        match row:
            case "message", name, data:
                return msgspec.msgpack.decode(data, type=_named(name))
            case "array", dtype, shape, order, data:
                return np.ndarray(shape, dtype, data, order=order).copy(order)
            case "pose", rotation, translation:
                return pin.SE3(np.frombuffer(rotation).reshape(3, 3), np.frombuffer(translation))
            case "partial", function, values, named:
                named = {key: self._value(item) for key, item in named.items()}
                return functools.partial(self._value(function), *self._value(values), **named)
            case "made" | "object", name, _:
                return object.__new__(_named(name))
            case "deque", most, _:
                return deque(maxlen=most)
            case "iterator", items:
                return iter([self._value(item) for item in items])
            case "struct", name, fields:
                return _named(name)(**{key: self._value(item) for key, item in fields.items()})
        return _EMPTY[row[0]]()

    def _fill(self, x: Any, row: Any) -> None:
        """Give an object what it had."""
        match row:
            case "object", _, fields:
                for name in _fields(x).keys() - fields.keys():
                    object.__delattr__(x, name)
                for name, item in fields.items():
                    object.__setattr__(x, name, self._value(item))
            case "made", _, state:
                x.__setstate__(self._value(state))
            case "list", items:
                x[:] = map(self._value, items)
            case (("dict" | "counter"), rows):
                x.clear()
                x.update([(self._value(key), self._value(item)) for key, item in rows])
            case ("set", items) | ("deque", _, items):
                x.clear()
                (x.update if row[0] == "set" else x.extend)(map(self._value, items))
            case "array", dtype, shape, order, data:
                x[...] = np.ndarray(shape, dtype, data, order=order)
            case "random", state:
                x.bit_generator.state = json.loads(state)
            case _:
                raise RunError(f"the state changes a constant {type(x).__qualname__}")

    def _value(self, x: Any) -> Any:
        """Return the value that something in a row stands for."""
        match x:
            case "ref", number:
                return self._object(number)
            case "tuple", items:
                return tuple(map(self._value, items))
            case "enum", name, value:
                return _named(name)(value)
            case "scalar", dtype, data:
                return np.frombuffer(data, dtype)[0]
            case "named", name, items:
                return _named(name)(*map(self._value, items))
            case "frozenset", items:
                return frozenset(map(self._value, items))
            case "method", owner, name:
                return getattr(self._value(owner), name)
            case "name", name:
                return _named(name)
        return x


class Remembering(Participant):
    """A participant that saves all that has changed since its `start`, which ends with `remember`.

    It may have objects of this package and of NumPy, containers, poses and messages. A class that
    has others defines `__getstate__` and `__setstate__`. What is there after `start` may have any.
    """

    _reasons: frozenset[str] = frozenset()

    def remember(self, *constant: Any) -> None:
        """Take all that there is now as what every start makes; constant: what no step changes."""
        self._constant = constant
        self._first = _Objects(constant)
        self._first.describe(self)

    def save(self) -> bytes | None:
        """Return how all objects differ from those after `start`; None if it cannot be said."""
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
        return _encode({n: row for n, row in now.rows.items() if row != first.get(n)})

    def restore(self, state: bytes) -> None:
        """Change all objects as `save` has found them."""
        _Restored(self._first.objects, msgspec.msgpack.decode(state))
