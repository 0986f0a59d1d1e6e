"""Where the items are: as the planogram says, until they are seen or carried."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Vector


@dataclass(frozen=True, kw_only=True)
class Seen:
    """A detection of an item on the map: x, y [m], yaw [rad]."""

    type: str
    x: float
    y: float
    yaw: float


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where an item is: position [m] and yaw [rad] of its link on the map."""

    x: float
    y: float
    z: float
    yaw: float

    def frame(self) -> pin.SE3:
        """Return it as a transform."""
        return pin.SE3(pin.utils.rotate("z", self.yaw), np.array([self.x, self.y, self.z]))


class Items:
    """All items that the planogram lists.

    types: name → type. places: name → where the planogram has it. same: farther from where it is
    expected, a detection is another item [m].
    """

    def __init__(self, types: Mapping[str, str], places: Mapping[str, Place], same: float) -> None:
        self._types = types
        self._places = dict(places)
        self._same = same
        self._held = ""
        self._in_tip = pin.SE3.Identity()

    @property
    def held(self) -> str:
        """Return the item that the gripper must be holding; empty: none."""
        return self._held

    def see(self, found: Sequence[Seen]) -> None:
        """Correct where items are by what the camera sees of them."""
        for seen in found:
            name = self._nearest(seen)
            if name and name != self._held:
                place = self._places[name]
                self._places[name] = replace(place, x=seen.x, y=seen.y, yaw=seen.yaw)

    def _nearest(self, seen: Seen) -> str:
        rows = [
            (math.hypot(place.x - seen.x, place.y - seen.y), name)
            for name, place in self._places.items()
            if self._types[name] == seen.type
        ]
        away, name = min(rows, default=(math.inf, ""))
        return name if away < self._same else ""

    def carry(self, tip: pin.SE3, *, holding: bool) -> None:
        """Move what the gripper holds along with its tip; nobody says which item that is."""
        if holding and not self._held:
            self._held = self._at(tip.translation)
            if self._held:
                self._in_tip = tip.inverse() * self._places[self._held].frame()
        if self._held:
            pose = tip * self._in_tip
            x, y, z = pose.translation.tolist()
            yaw = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])
            self._places[self._held] = Place(x=x, y=y, z=z, yaw=yaw)
        if not holding:
            self._held = ""

    def _at(self, tip: Vector) -> str:
        rows = [
            (math.dist((place.x, place.y, place.z), tip), name)
            for name, place in self._places.items()
            if math.hypot(place.x - tip[0], place.y - tip[1]) < self._same
        ]
        return min(rows, default=(math.inf, ""))[1]

    def place(self, name: str) -> Place:
        """Return where an item is."""
        return self._places[name]
