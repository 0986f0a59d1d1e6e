"""The commands of the legacy remote API, as calls of the functions of the ZeroMQ one."""

import struct
from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from typing import Any

from stepbus_coppelia.clients import ApiError

Call = Callable[[str, Sequence[Any]], list[Any]]
"""Call a function by its name; raises ApiError."""
Row = tuple[list[Any], list[Any], list[Any]]
"""Whole numbers, numbers and texts about an object."""
Rows = Callable[[Call, int], Row]

ENABLE, DISABLE, TRIGGER, LAST_ERRORS, FINISH = 1, 2, 3, 4, 10
"""Commands about the connection, which are not here."""
RUN_STATE, GET_AND_CLEAR = 0x1007, 0x3017

_WORLD, _ALL, _PARENT, _SCENE = -1, -2, -11, -12
_ALL_OBJECTS, _END_OF_TYPES = 109, 18
"""What else names all objects; from where on a number is a collection and no type of objects."""
_JOINT, _PROXIMITY_SENSOR = 1, 5
_RUN_STATES = {0: "startSimulation", 1: "pauseSimulation", 2: "stopSimulation"}
_SCRIPT_INFOS = 450
"""Verbosity of what a script says."""


# --- bytes -----------------------------------------------------------------------------------


def _read(form: str, raw: bytes) -> list[Any]:
    """Return what some bytes start with. form: of `struct`; `b`: all of them; `s`: names."""
    if form == "b":
        return [raw]
    if form.strip("s"):
        try:
            return list(struct.unpack_from(f"<{form}", raw))
        except struct.error:
            raise ApiError(f"it came with {len(raw)} bytes, which are no {form!r}") from None
    names = raw.split(b"\0", len(form))
    if len(names) <= len(form):
        raise ApiError(f"it came with {len(names) - 1} names instead of {len(form)}")
    return [name.decode(errors="replace") for name in names[: len(form)]]


def _flat(values: Iterable[Any]) -> list[Any]:
    """Return values with the lists among them opened."""
    return list(chain.from_iterable(v if isinstance(v, list | tuple) else (v,) for v in values))


def _pack(form: str, values: Iterable[Any]) -> bytes:
    """Return numbers as bytes. form: `f` or `i` for any number of them, `3f` for just three."""
    flat = _flat(values)
    kind, count = form[-1], form[:-1] or len(flat)
    try:
        numbers = [float(v) if kind == "f" else int(v) for v in flat]
        return struct.pack(f"<{count}{kind}", *numbers)
    except (TypeError, ValueError, OverflowError, struct.error):
        raise ApiError(f"its result is {flat!r}, which is no {count}{kind}") from None


def _text(values: Sequence[Any]) -> bytes:
    """Return the first value, text or bytes, as bytes. Raises ApiError if there is none."""
    if not values or not isinstance(values[0], str | bytes):
        raise ApiError("it has no text as its result")
    return values[0].encode() if isinstance(values[0], str) else values[0]


def _found(result: int) -> bytes:
    """Return what a sensor found as a byte. Raises ApiError if it was never read."""
    if result < 0:
        raise ApiError("the sensor was never handled")
    return bytes([result & 0xFF])


def _vector(value: Any) -> Sequence[float]:
    """Return a vector, of zeros where there is none."""
    return value or (0.0, 0.0, 0.0)


# --- functions that are no plain call --------------------------------------------------------


def _object(call: Call, name: str) -> list[Any]:
    """Find an object by a path, or by a name of old: `joint#0` was the second joint."""
    base, mark, copy = name.rpartition("#")
    tries: list[list[Any]] = [[name if name[:1] in {"/", ".", ":"} else f"/{name}"]]
    if mark:
        index = int(copy) + 1 if copy.isdecimal() else 0
        tries += [[f"/{base}", {"index": index}], [f"/{base}"]]
    for args in tries[:-1]:
        try:
            return call("getObject", args)
        except ApiError:
            continue
    return call("getObject", tries[-1])


def _collection(call: Call, name: str) -> list[Any]:
    """Find a collection; of those without a name a signal has the number."""
    try:
        return call("getCollectionHandle", [name])
    except ApiError:
        return call("getInt32Signal", [name])


def _of_type(call: Call, kind: int) -> list[Any]:
    return _flat(call("getObjectsInTree", [_SCENE, _ALL if kind == _ALL_OBJECTS else kind, 0]))


def _copies(call: Call, handles: bytes) -> list[Any]:
    return _flat(call("copyPasteObjects", [_read(f"{len(handles) // 4}i", handles), 0]))


def _counted(found: Callable[..., list[Any]]) -> Callable[..., bytes]:
    return lambda call, arg: _pack("i", [len(handles := found(call, arg)), *handles])


def _place(function: str) -> Callable[..., list[Any]]:
    """Return a command that sets a vector relative to an object."""
    return lambda call, handle, to, *values: call(function, [handle, list(values), to])


def _image(function: str, options: int) -> Callable[[Call, int], bytes]:
    def read(call: Call, handle: int) -> bytes:
        pixels, size = call(function, [handle, options])[:2]
        return _pack("2i", size) + _text([pixels])

    return read


def _vision(call: Call, handle: int) -> bytes:
    found, *packets = call("readVisionSensor", [handle])
    counts = _pack("i", [len(packets), *map(len, packets)])
    return _found(found) + counts + _pack("f", packets)


def _proximity(call: Call, handle: int) -> bytes:
    found, _, point, other, normal = call("readProximitySensor", [handle])
    return (
        _found(found)
        + _pack("3f", _vector(point))
        + _pack("1i", [other or 0])
        + _pack("3f", _vector(normal))
    )


def _force(call: Call, handle: int) -> bytes:
    found, force, torque = call("readForceSensor", [handle])
    return _found(found) + _pack("6f", [_vector(force), _vector(torque)])


def _take(call: Call, name: str) -> bytes:
    """Return a string signal, and clear it."""
    value = _text(call("getStringSignal", [name]))
    call("clearStringSignal", [name])
    return value


def _stream(call: Call, name: str) -> bytes:
    """Return what a stream has; the client joins what it gets."""
    try:
        return _take(call, name)
    except ApiError:
        return b""


def _append(call: Call, name: str, more: bytes) -> None:
    before = next(iter(call("getStringSignal", [name])), None)
    call("setStringSignal", [name, (_text([before]) if before else b"") + more])


def _clear(function: str) -> Callable[[Call, str], list[Any]]:
    """Return a command that clears a signal, or all if it names none."""
    return lambda call, name: call(function, [name] if name else [])


def _script(call: Call, named: bytes, data: bytes) -> bytes:
    """Call a script's function with whole numbers, numbers, texts and bytes; so is its answer."""
    (where,) = _read("i", named)
    script, function = _read("ss", named[4:])
    ints, floats, texts, size = (max(count, 0) for count in _read("4i", data))
    numbers = _read(f"16x{ints}i{floats}f", data)
    rest = data[16 + 4 * len(numbers) :]
    if texts > len(rest):
        raise ApiError(f"it came with {len(rest)} bytes, too few for {texts} texts")
    strings = _read("s" * texts, rest)
    raw = rest.split(b"\0", texts)[-1][:size]
    args = [numbers[:ints], numbers[ints:], strings, raw]
    name = f"{function}@{script}" if script else function
    results = [*call("callScriptFunction", [name, where, *args]), None, None, None, None]
    gives = [result or [] for result in results[:3]]
    last = _text([results[3] or b""])
    counts = _pack("4i", [*map(len, gives), len(last)])
    ends = [_text([text]).partition(b"\0")[0] + b"\0" for text in gives[2]]
    return b"".join([counts, _pack("i", gives[0]), _pack("f", gives[1]), *ends, last])


# --- data of many objects --------------------------------------------------------------------


def _floats(*reads: str, args: Sequence[int] = ()) -> Rows:
    """Return how to read numbers with some functions, each given the object and `args`."""
    return lambda call, handle: (
        [],
        [value for read in reads for value in _flat(call(f"get{read}", [handle, *args]))],
        [],
    )


def _only(kind: int, read: Rows, ints: int, floats: int) -> Rows:
    """Return how to read objects of a type; the others give -1 and 0.0."""

    def run(call: Call, handle: int) -> Row:
        if call("getObjectType", [handle])[0] == kind:
            return read(call, handle)
        return [-1] * ints, [0.0] * floats, []

    return run


def _proximity_row(call: Call, handle: int) -> Row:
    found, _, point, other, normal = call("readProximitySensor", [handle])
    return [found, other or 0], [*_vector(point), *_vector(normal)], []


_ROWS: dict[int, Rows] = {
    0: lambda call, handle: ([], [], call("getObjectAlias", [handle])),
    1: lambda call, handle: (call("getObjectType", [handle]), [], []),
    2: lambda call, handle: (call("getObjectParent", [handle]), [], []),
    13: _only(_PROXIMITY_SENSOR, _proximity_row, 2, 6),
    15: _only(_JOINT, _floats("JointPosition", "JointForce"), 0, 2),
    17: lambda call, handle: ([], call("getObjectVelocity", [handle])[0], []),
    18: lambda call, handle: ([], call("getObjectVelocity", [handle])[1], []),
    19: _floats("ObjectVelocity"),
    20: lambda call, handle: ([], [], call("getObjectAlias", [handle])),
    21: lambda call, handle: ([], [], call("getObjectAlias", [handle, 2])),
}
for _at, _what in ((3, "Position"), (5, "Orientation"), (7, "Quaternion")):
    for _more, _to in enumerate((_WORLD, _PARENT)):
        _ROWS[_at + _more] = _floats(f"Object{_what}", args=[_to])
        if _what != "Position":
            _ROWS[_at + 4 + _more] = _floats("ObjectPosition", f"Object{_what}", args=[_to])


def _group(call: Call, group: int, kind: int) -> bytes:
    """Read something of all objects of a type or in a collection."""
    if kind not in _ROWS:
        raise ApiError(f"there is no data type {kind}")
    if 0 <= group < _END_OF_TYPES or group == _ALL_OBJECTS:
        handles = _of_type(call, group)
    else:
        handles = _flat(call("getCollectionObjects", [group]))
    rows = [_ROWS[kind](call, handle) for handle in handles]
    ints, floats, texts = ([value for row in rows for value in row[at]] for at in range(3))
    counts = _pack("4i", [len(handles), len(ints), len(floats), len(texts)])
    names = (_text([text]) + b"\0" for text in texts)
    return b"".join([counts, _pack("i", handles), _pack("i", ints), _pack("f", floats), *names])


# --- all commands ----------------------------------------------------------------------------

_PLAIN = """
0005 closeScene - - -   0009 createDummy - f 1i   1001 getJointPosition i - 1f
1002 setJointPosition i f -   1008 setJointTargetVelocity i f -   100a getJointMatrix i - 12f
100c setJointTargetPosition i f -   100d getJointForce i - 1f   1012 getObjectParent i - 1i
1018 getObjectOrientation i i 3f   1019 getObjectPosition i i 3f   101c setObjectParent i i? -
101d getArrayParam i - 3f   101f getBoolParam i - 1i   1020 setBoolParam i ? -
1021 getInt32Param i - 1i   1022 setInt32Param i i -   1023 getFloatParam i - 1f
1024 setFloatParam i f -   1026 readCollision i - 1i   1027 readDistance i - 1f
1034 getModelProperty i - 1i   1035 setModelProperty i i -   1036 getObjectVelocity i - 6f
1037 removeModel i - -   1038 getJointTargetForce i - 1f   2007 getObjectFloatParam 2i - 1f
2008 getObjectInt32Param 2i - 1i   2009 setObjectFloatParam 2i f -
200a setObjectInt32Param 2i i -   200b getObjectChild 2i - 1i   200d getObjectOrientation 2i - 3f
200e getObjectPosition 2i - 3f   2801 getObjectQuaternion 2i - 4f   3002 loadScene s - -
3003 loadModel s - 1i   300a getCollisionHandle s - 1i   300b getDistanceHandle s - 1i
3010 getFloatSignal s - 1f   3011 getInt32Signal s - 1i   3013 setFloatSignal s f -
3014 setInt32Signal s i -   3015 setStringSignal s b -
"""
"""Number and function, what the command is named by, its data, its answer's; - is nothing."""
_TABLE: dict[int, tuple[str | Callable[..., Any], str, str, str]] = {
    0x1003: (_image("getVisionSensorImg", 1), "i", "", ""),
    0x1004: (_image("getVisionSensorImg", 0), "i", "", ""),
    RUN_STATE: (lambda call, which: call(_RUN_STATES.get(which, "?"), []), "i", "", ""),
    0x1009: (_proximity, "i", "", ""),
    # The most force: its sign is that of the target velocity.
    0x100E: (lambda call, *args: call("setJointTargetForce", [*args, False]), "i", "f", ""),
    0x100F: (_force, "i", "", ""),
    0x1011: (_vision, "i", "", ""),
    0x1017: (_image("getVisionSensorDepth", 0), "i", "", ""),
    0x101A: (_place("setObjectOrientation"), "i", "i3f", ""),
    0x101B: (_place("setObjectPosition"), "i", "i3f", ""),
    0x101E: (lambda call, *args: call("setArrayParam", [args[0], list(args[1:])]), "i", "3f", ""),
    0x1025: (lambda call, *args: _text(call("getStringParam", args)) + b"\0", "i", "", ""),
    0x1028: (lambda call, handle: call("removeObjects", [[handle]]), "i", "", ""),
    0x102A: (_counted(_of_type), "i", "", ""),
    0x102E: (_counted(_copies), "", "b", ""),
    0x1801: (_place("setObjectQuaternion"), "i", "i4f", ""),
    0x200C: (_group, "2i", "", ""),
    0x200F: (lambda call, *args: call("checkCollision", args)[:1], "2i", "", "1i"),
    0x2010: (lambda call, *args: call("checkDistance", [*args, 0.0])[1][6:], "2i", "", "1f"),
    0x3001: (_object, "s", "", "1i"),
    0x3008: (lambda call, text: call("addLog", [_SCRIPT_INFOS, text]), "s", "", ""),
    0x300D: (_clear("clearFloatSignal"), "s", "", ""),
    0x300E: (_clear("clearInt32Signal"), "s", "", ""),
    0x300F: (_clear("clearStringSignal"), "s", "", ""),
    0x3012: (lambda call, name: _text(call("getStringSignal", [name])), "s", "", ""),
    0x3016: (_append, "s", "b", ""),
    GET_AND_CLEAR: (_take, "s", "", ""),
    0x3018: (_stream, "s", "", ""),
    0x3019: (_collection, "s", "", "1i"),
    0x3401: (_script, "b", "b", ""),
}
for _code, _name, *_forms in zip(*[iter(_PLAIN.split())] * 5, strict=True):
    _named, _takes, _gives = (form.strip("-") for form in _forms)
    _TABLE[int(_code, 16)] = (_name, _named, _takes, _gives)
_REFUSED = """
0006 GetObjectSelection 1005 SetVisionSensorImage 1006 SetVisionSensorImage
100b SetSphericalJointMatrix 1010 BreakForceSensor 1014 AuxiliaryConsoleClose
1015 AuxiliaryConsolePrint 1016 AuxiliaryConsoleShow 1029 RemoveUI 102b EndDialog
102c GetDialogInput 102d GetDialogResult 102f SetObjectSelection 2001 GetUISlider
2002 SetUISlider 2003 GetUIEventButton 2004 GetUIButtonProperty 2005 SetUIButtonProperty
2006 SetUIButtonLabel 3004 TransferFile 3005 LoadUI 3006 EraseFile 3007 GetUIHandle
3009 AuxiliaryConsoleOpen 300c DisplayDialog
"""
_NAMES = dict(zip(*[iter(_REFUSED.split())] * 2, strict=True))


def run(call: Call, number: int, named: bytes, data: bytes) -> bytes:
    """Run a command; return the data of its answer. Raises ApiError."""
    if number not in _TABLE:
        name = _NAMES.get(f"{number:04x}", f"Command{number:04x}")
        call(f"simx{name}", [])
        raise ApiError(f"simx{name} is not served")
    function, identity, takes, gives = _TABLE[number]
    args = _read(identity, named) + _read(takes, data)
    result = call(function, args) if isinstance(function, str) else function(call, *args)
    if isinstance(result, bytes):
        return result
    return _pack(gives, result) if gives else b""
