"""The commands of the legacy remote API, as calls of the functions of the ZeroMQ one."""

import contextlib
import struct
from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from typing import Any

from stepbus_coppelia.clients import ApiError

Call = Callable[[str, Sequence[Any]], list[Any]]
"""Call a function by its name; raises ApiError."""

ENABLE, DISABLE, TRIGGER, LAST_ERRORS, FINISH = 1, 2, 3, 4, 10
RUN_STATE = 0x1007
"""Numbers of commands; the first five are about the connection, and not here."""

_WORLD, _ALL, _PARENT, _SCENE, _ALL_OBJECTS = -1, -2, -11, -12, 109
_JOINT, _PROXIMITY_SENSOR, _END_OF_TYPES, _SCRIPT_INFOS = 1, 5, 18, 450
_RUN_STATES = ("startSimulation", "pauseSimulation", "stopSimulation")


def _read(form: str, raw: bytes) -> list[Any]:
    """Return what some bytes start with.

    form: of `struct`; `s`: names; `n`: a name that may be empty, for none; `b`: all of them; `=1`:
    always 1.
    """
    if form in {"", "b"} or form[0] == "=":
        return [raw] if form == "b" else [int(value) for value in form[1:]]
    if form.strip("sn"):
        try:
            return list(struct.unpack_from(f"<{form}", raw))
        except struct.error:
            raise ApiError(f"the command has {len(raw)} bytes, which are no {form!r}") from None
    names = [name.decode(errors="replace") for name in raw.split(b"\0", len(form))]
    if len(names) <= len(form):
        raise ApiError(f"the command has {len(names) - 1} names instead of {len(form)}")
    return names[: len(form)] if form != "n" or names[0] else []


def _pack(form: str, values: Iterable[Any]) -> bytes:
    """Return values, in lists or not, as bytes.

    form: `3f` for three numbers, `f` or `i` for any number, `c` for whole ones behind their count;
    `t`: the first, a text; `z`: and a zero; `p`: pixels and their size. Raises ApiError.
    """
    flat = _flat(values)
    kind, count = form[-1], int(form[:-1] or len(flat))
    try:
        if kind in "tz":
            text = flat[0].encode() if isinstance(flat[0], str) else memoryview(flat[0])
            return bytes(text) + b"\0" * (kind == "z")
        if kind == "p":
            return _pack("2i", flat[1:]) + _pack("t", flat)
        if kind == "c":
            return _pack("i", [count, *flat])
        numbers = [float(v) if kind == "f" else int(v) for v in flat[:count]]
        return struct.pack(f"<{count}{kind}", *numbers)
    except (IndexError, TypeError, ValueError, OverflowError, struct.error):
        raise ApiError(f"the function returned {str(flat)[:80]}, which is no {form!r}") from None


def _flat(values: Iterable[Any]) -> list[Any]:
    """Return values with the lists among them opened."""
    return list(chain.from_iterable(v if isinstance(v, list | tuple) else (v,) for v in values))


def _object(call: Call, name: str) -> list[Any]:
    """Find an object by a path, or by a name of old: `joint#0` was the second joint."""
    path = name if name[:1] in {"/", ".", ":"} else f"/{name}"
    base, mark, copy = path.rpartition("#")
    index = {"index": int(copy) + 1 if copy.isdecimal() else 0}
    tries: list[list[Any]] = [[path], [base, index]] if mark else []
    for args in tries:
        with contextlib.suppress(ApiError):
            return call("getObject", args)
    return call("getObject", [base if mark else path])


def _of_type(call: Call, kind: int) -> list[Any]:
    return _flat(call("getObjectsInTree", [_SCENE, _ALL if kind == _ALL_OBJECTS else kind, 0]))


def _place(function: str) -> Callable[..., list[Any]]:
    """Return a command that sets a vector relative to an object."""
    return lambda call, handle, to, *values: call(function, [handle, list(values), to])


def _vision(call: Call, handle: int) -> bytes:
    found, *packets = call("readVisionSensor", [handle])
    packets = [packet for packet in packets if packet]
    return struct.pack("<B", found) + _pack("c", map(len, packets)) + _pack("f", packets)


def _proximity(call: Call, handle: int) -> bytes:
    found, _, point, other, normal = call("readProximitySensor", [handle])
    vectors = [vector or (0.0, 0.0, 0.0) for vector in (point, normal)]
    return struct.pack("<B3fi3f", found, *vectors[0], other, *vectors[1])


def _script(call: Call, named: bytes, data: bytes) -> bytes:
    """Call a script's function with whole numbers, numbers, texts and bytes; so is its answer."""
    (where,) = _read("i", named)
    script, function = _read("ss", named[4:])
    ints, floats, texts, size = (max(count, 0) for count in _read("4i", data))
    numbers = _read(f"16x{ints}i{floats}f", data)
    rest = data[16 + 4 * len(numbers) :]
    strings = _read("s" * min(texts, len(rest) + 1), rest)
    args = [numbers[:ints], numbers[ints:], strings, rest.split(b"\0", texts)[-1][:size]]
    name = f"{function}@{script}" if script else function
    results = [*call("callScriptFunction", [name, where, *args]), None, None, None, None]
    gives, last = [result or [] for result in results[:3]], _pack("t", [results[3] or b""])
    counts = _pack("4i", [*map(len, gives), len(last)])
    ends = [_pack("z", [text]) for text in gives[2]]
    return b"".join([counts, _pack("i", gives[0]), _pack("f", gives[1]), *ends, last])


_DATA = """0 ObjectAlias 1 ObjectType 2 ObjectParent 3 ObjectPosition 5 ObjectOrientation
7 ObjectQuaternion 9 ObjectPosition+ObjectOrientation 11 ObjectPosition+ObjectQuaternion
15 JointPosition+JointForce 17 ObjectVelocity 19 ObjectVelocity 20 ObjectAlias 21 ObjectAlias"""
"""Number of a kind of data, and what to read for it."""
_PAIRS = zip(*[iter(_DATA.split())] * 2, strict=True)
_READS = {int(kind): reads.split("+") for kind, reads in _PAIRS}
_READS |= {kind + 1: _READS[kind] for kind in (3, 5, 7, 9, 11, 17)}
_OPTIONS = {21: 2} | {kind: _WORLD if kind % 2 else _PARENT for kind in range(3, 13)}
_ONLY = {13: (_PROXIMITY_SENSOR, 2, 6), 15: (_JOINT, 0, 2)}
"""Data that one type of objects has; the others give so often -1 and 0.0."""


def _row(call: Call, handle: int, kind: int) -> tuple[list[Any], list[Any], list[Any]]:
    """Return whole numbers, numbers and texts about an object."""
    if kind in _ONLY:
        only, ints, floats = _ONLY[kind]
        if call("getObjectType", [handle])[0] != only:
            return [-1] * ints, [0.0] * floats, []
    if kind == 13:
        found, x, y, z, other, *normal = struct.unpack("<B3fi3f", _proximity(call, handle))
        return [found, other], [x, y, z, *normal], []
    args = [handle, _OPTIONS[kind]] if kind in _OPTIONS else [handle]
    values = [v for read in _READS[kind] for v in _flat(call(f"get{read}", args))]
    if kind in {0, 1, 2, 20, 21}:
        return ([], [], values) if isinstance(values[0], str) else (values, [], [])
    return [], values[3 if kind == 18 else 0 : 3 if kind == 17 else None], []


def _group(call: Call, group: int, kind: int) -> bytes:
    """Read something of all objects of a type."""
    if kind != 13 and kind not in _READS:
        raise ApiError(f"there is no data type {kind}")
    if not (0 <= group < _END_OF_TYPES or group == _ALL_OBJECTS):
        raise ApiError("collections are not available in stepbus")
    handles = _of_type(call, group)
    rows = [_row(call, handle, kind) for handle in handles]
    ints, floats, texts = ([value for row in rows for value in row[at]] for at in range(3))
    counts = _pack("4i", [*map(len, (handles, ints, floats, texts))])
    names = (_pack("z", [text]) for text in texts)
    return b"".join([counts, _pack("i", handles), _pack("i", ints), _pack("f", floats), *names])


_PLAIN = """
0009 createDummy - f 1i   1001 getJointPosition i - 1f   1002 setJointPosition i f -
1008 setJointTargetVelocity i f -   100c setJointTargetPosition i f -   100d getJointForce i - 1f
1012 getObjectParent i - 1i   1018 getObjectOrientation i i 3f   1019 getObjectPosition i i 3f
101c setObjectParent i i? -   101f getBoolParam i - 1i   1020 setBoolParam i ? -
1021 getInt32Param i - 1i   1022 setInt32Param i i -   1023 getFloatParam i - 1f
1024 setFloatParam i f -   1036 getObjectVelocity i - 6f   1038 getJointTargetForce i - 1f
2007 getObjectFloatParam 2i - 1f   2008 getObjectInt32Param 2i - 1i
2009 setObjectFloatParam 2i f -   200a setObjectInt32Param 2i i -
200d getObjectOrientation 2i - 3f   200e getObjectPosition 2i - 3f
2801 getObjectQuaternion 2i - 4f   3002 loadScene s - -   3003 loadModel s - 1i
3010 getFloatSignal s - 1f   3011 getInt32Signal s - 1i   3013 setFloatSignal s f -
3014 setInt32Signal s i -   3015 setStringSignal s b -   3012 getBufferSignal s - t
300d clearFloatSignal n - -   300e clearInt32Signal n - -   300f clearStringSignal n - -
1003 getVisionSensorImg i =1 p   1004 getVisionSensorImg i =0 p   1025 getStringParam i - z
1017 getVisionSensorDepth i =0 p   200f checkCollision 2i - 1i   1026 readCollision i - 1i
300a getCollisionHandle s - 1i   200b getObjectChild 2i - 1i   1037 removeModel i - -
"""
"""Number and function, what the command is named by, its data, its answer's; - is nothing."""
_TABLE: dict[int, tuple[str | Callable[..., Any], str, str, str]] = {
    RUN_STATE: (lambda call, which: call(_RUN_STATES[which], []), "i", "", ""),
    0x1005: (lambda call, h, image: call("setVisionSensorImg", [h, image, 1]), "i", "b", ""),
    0x1006: (lambda call, h, image: call("setVisionSensorImg", [h, image, 0]), "i", "b", ""),
    0x1009: (_proximity, "i", "", ""),
    # The most force: its sign is that of the target velocity.
    0x100E: (lambda call, *args: call("setJointTargetForce", [*args, False]), "i", "f", ""),
    0x1011: (_vision, "i", "", ""),
    0x101A: (_place("setObjectOrientation"), "i", "i3f", ""),
    0x101B: (_place("setObjectPosition"), "i", "i3f", ""),
    0x1028: (lambda call, handle: call("removeObjects", [[handle]]), "i", "", ""),
    0x102A: (_of_type, "i", "", "c"),
    0x1801: (_place("setObjectQuaternion"), "i", "i4f", ""),
    0x200C: (_group, "2i", "", ""),
    0x3001: (_object, "s", "", "1i"),
    0x3008: (lambda call, text: call("addLog", [_SCRIPT_INFOS, text]), "s", "", ""),
    0x3401: (_script, "b", "b", ""),
}
for _code, _name, *_forms in zip(*[iter(_PLAIN.split())] * 5, strict=True):
    _named, _takes, _gives = (form.strip("-") for form in _forms)
    _TABLE[int(_code, 16)] = (_name, _named, _takes, _gives)
_REFUSED = """
0005 CloseScene 0006 GetObjectSelection 100a GetJointMatrix 100b SetSphericalJointMatrix
100f ReadForceSensor 1010 BreakForceSensor 1014 AuxiliaryConsoleClose 1015 AuxiliaryConsolePrint
1016 AuxiliaryConsoleShow 101d GetArrayParameter 101e SetArrayParameter 1027 ReadDistance
1029 RemoveUI 102b EndDialog 102c GetDialogInput 102d GetDialogResult 102e CopyPasteObjects
102f SetObjectSelection 1034 GetModelProperty 1035 SetModelProperty 2001 GetUISlider
2002 SetUISlider 2003 GetUIEventButton 2004 GetUIButtonProperty 2005 SetUIButtonProperty
2006 SetUIButtonLabel 2010 CheckDistance 3004 TransferFile 3005 LoadUI 3006 EraseFile
3007 GetUIHandle 3009 AuxiliaryConsoleOpen 300b GetDistanceHandle 300c DisplayDialog
3016 AppendStringSignal 3017 GetAndClearStringSignal 3018 ReadStringStream 3019 GetCollectionHandle
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
    try:
        result = call(function, args) if isinstance(function, str) else function(call, *args)
    except (IndexError, TypeError, ValueError) as exc:
        raise ApiError(f"command {number:#06x} of the legacy API: {exc!r}") from exc
    if isinstance(result, bytes):
        return result
    return _pack(gives, result) if gives else b""
