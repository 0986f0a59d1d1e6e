"""Reads what the scenario says about the sales, with checks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from stepbus_participant import Config
from stepbus_participant.settings import Settings, nearest

from .geometry import Spot
from .settings import (
    Grasp,
    Heights,
    Order,
    Outlet,
    Ports,
    StoreSettings,
    Tolerances,
    Waits,
)

_SUMMARY = "summary"


def read_ports(settings: Settings, config: Config) -> Ports:
    """Return the names of the ports, by their types."""
    events = [name for name, port in config.outputs.items() if port.type == "Event/1"]
    if _SUMMARY in events and len(events) == 2:
        told, summary = next(name for name in events if name != _SUMMARY), _SUMMARY
    else:
        told = summary = settings.output_of("Event/1")
    ports = Ports(
        poses=settings.input_of("Poses/1"),
        detections=settings.input_of("Detections/1"),
        gripper=settings.input_of("GripperState/1"),
        odometry=settings.input_of("BaseState/1"),
        status=settings.input_of("GoalStatus/1"),
        goal=settings.output_of("Goal/1"),
        events=told,
        summary=summary,
    )
    settings.outputs_are("Goal/1", "Event/1")
    return ports


def read_settings(settings: Settings) -> StoreSettings:
    """Return what the scenario says; what is wrong with it is noted in the settings."""
    orders = _read_orders(settings)
    return StoreSettings(
        orders=orders,
        home=_spot(settings, "home", [0.0, 0.0, 0.0]),
        shelves=_read_shelves(settings),
        stand=settings.number("stand", 0.45, bound="positive"),
        reverse=settings.number("reverse", 0.3, bound="positive"),
        tuck=_read_tuck(settings),
        carry=_read_carry(settings),
        base_frame=_link(settings, "base_frame", settings.value("base_frame", "chassis")),
        attempts=_whole(settings, "attempts", 2),
        corrections=_whole(settings, "corrections", 3),
        looks=_whole(settings, "looks", 3),
        outlet=_read_outlet(settings, len(orders)),
        grasp=_read_grasp(settings),
        heights=_read_heights(settings),
        tolerances=_read_tolerances(settings),
        waits=_read_waits(settings),
    )


def _read_orders(settings: Settings) -> tuple[Order, ...]:
    rows = settings.value("orders")
    if not isinstance(rows, list | tuple) or not rows:
        if rows is not None:
            settings.note("orders", f"is {rows!r}, not a list of kinds")
        return ()
    orders = [_order(settings, f"orders.{at}", row) for at, row in enumerate(rows)]
    items = [order.item for order in orders if order.item]
    for name in dict.fromkeys(items):
        if items.count(name) > 1:
            settings.note("orders", f"item {name!r} is sold twice")
    return tuple(orders)


def _order(settings: Settings, where: str, row: Any) -> Order:
    if isinstance(row, str) and row:
        return Order(kind=row)
    if isinstance(row, Mapping) and len(row) == 1:
        word, value = next(iter(row.items()))
        if isinstance(value, str) and value and word in {"kind", "item"}:
            return Order(**{word: value})
    settings.note(where, f"is {row!r}; write a kind, `kind: cola` or `item: cola_a1_3`")
    return Order()


def _read_shelves(settings: Settings) -> dict[str, Spot]:
    rows = settings.value("shelves")
    if not isinstance(rows, Mapping) or not rows:
        if rows is not None:
            settings.note("shelves", f"is {rows!r}, not a map from names to `front` and `yaw`")
        return {}
    return {str(name): _shelf(settings, f"shelves.{name}", row) for name, row in rows.items()}


def _shelf(settings: Settings, where: str, row: Any) -> Spot:
    values = _keys(settings, where, row, {"front": None, "yaw": 0.0})
    x, y = _numbers(settings, f"{where}.front", values["front"], ["x", "y"])
    return Spot(x=x, y=y, yaw=settings.as_number(f"{where}.yaw", values["yaw"]))


def _read_tuck(settings: Settings) -> dict[str, float]:
    row = settings.value("tuck")
    if not isinstance(row, Mapping) or not row:
        if row is not None:
            settings.note("tuck", f"is {row!r}, not a map from joints to [rad]")
        return {}
    return {str(name): settings.as_number(f"tuck.{name}", value) for name, value in row.items()}


def _read_carry(settings: Settings) -> tuple[float, float]:
    x, y = _numbers(settings, "carry", settings.value("carry", [0.45, 0.0]), ["x", "y"])
    return x, y


def _read_outlet(settings: Settings, orders: int) -> Outlet:
    defaults = {"position": None, "yaw": math.pi / 2, "pitch": 0.12, "length": 0.5}
    row = settings.value("outlet")
    values = _keys(settings, "outlet", row, {**defaults, "link": "outlet_top"})
    x, y, z = _numbers(settings, "outlet.position", values["position"], ["x", "y", "z"])
    yaw = settings.as_number("outlet.yaw", values["yaw"])
    pitch = settings.as_number("outlet.pitch", values["pitch"], "positive")
    length = settings.as_number("outlet.length", values["length"], "positive")
    if orders * pitch > length + 1e-9:
        row_length = f"{orders} orders, {pitch:g} m apart, do not fit into {length:g} m"
        settings.note("outlet", row_length)
    return Outlet(
        middle=Spot(x=x, y=y, yaw=yaw),
        height=z,
        pitch=pitch,
        spots=orders,
        link=_link(settings, "outlet.link", values["link"]),
    )


def _read_grasp(settings: Settings) -> Grasp:
    return Grasp(
        tip=_link(settings, "tip", settings.value("tip", "grasp")),
        yaw=settings.number("hand_yaw", 0.0),
        force=settings.number("force", 15.0, bound="positive"),
        opening=settings.number("opening", 0.09, bound="positive"),
        depth=settings.number("grasp_depth", 0.015, bound="positive"),
        reach=settings.number("grasp_reach", 0.065, bound="positive"),
        width_tolerance=settings.number("width_tolerance", 0.008, bound="positive"),
        down=settings.number("down", 1.5, bound="positive"),
    )


def _read_heights(settings: Settings) -> Heights:
    return Heights(
        look=settings.number("look_height", 0.2, bound="positive"),
        approach=settings.number("approach_height", 0.1, bound="positive"),
        lift=settings.number("lift_height", 0.1, bound="positive"),
        safe=settings.number("safe_height", 0.6, bound="positive"),
        step=settings.number("lower_step", 0.1, bound="positive"),
        drop=settings.number("drop_height", 0.003, bound="positive"),
    )


def _read_tolerances(settings: Settings) -> Tolerances:
    row = settings.value("tolerances", {})
    defaults = {"found": 0.06, "steady": 0.002, "placed": 0.01, "moved": 0.002, "tilt": 0.1}
    return Tolerances(**_positive(settings, "tolerances", row, defaults))


def _read_waits(settings: Settings) -> Waits:
    defaults = {
        "answer": 2.0,
        "motion": 60.0,
        "camera": 3.0,
        "still": 0.2,
        "rest": 0.5,
        "halt": 10.0,
        "lost": 0.1,
    }
    return Waits(**_positive(settings, "waits", settings.value("waits", {}), defaults))


def _positive(
    settings: Settings, where: str, row: Any, defaults: Mapping[str, float]
) -> dict[str, float]:
    """Return a map of positive numbers, with defaults."""
    values = _keys(settings, where, row, defaults)
    return {
        key: settings.as_number(f"{where}.{key}", value, "positive")
        for key, value in values.items()
    }


def _keys(settings: Settings, where: str, row: Any, defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a map, with defaults; None as a default: it has to be there."""
    if not isinstance(row, Mapping):
        if row is not None:
            settings.note(where, f"is {row!r}, not a map of {', '.join(defaults)}")
        return dict(defaults)
    for key in row:
        if key not in defaults:
            settings.note(f"{where}.{key}", f"is unknown; {nearest(str(key), defaults)}")
    values = {
        key: default if row.get(key) is None else row[key] for key, default in defaults.items()
    }
    for key, value in values.items():
        if value is None:
            settings.note(f"{where}.{key}", "is missing")
    return values


def _spot(settings: Settings, param: str, default: list[float]) -> Spot:
    x, y, yaw = _numbers(settings, param, settings.value(param, default), ["x", "y", "yaw"])
    return Spot(x=x, y=y, yaw=yaw)


def _numbers(settings: Settings, where: str, value: Any, names: list[str]) -> list[float]:
    """Return a vector out of a list; what is missing has been noted before."""
    if value is None:
        return [0.0] * len(names)
    if not isinstance(value, list | tuple):
        settings.note(where, f"is {value!r}, not a list of {', '.join(names)}")
        return [0.0] * len(names)
    return settings.as_vector(where, value, names)


def _link(settings: Settings, where: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        settings.note(where, f"is {value!r}, not the name of a link")
    return str(value)


def _whole(settings: Settings, param: str, default: int) -> int:
    return _as_whole(settings, param, settings.value(param, default))


def _as_whole(settings: Settings, where: str, value: Any) -> int:
    number = settings.as_number(where, value, "positive")
    if number != int(number):
        settings.note(where, f"is {number:g}, not a whole number")
    return int(number)
