"""What the gateway and its plant exchange beside joint states and joint commands."""

from typing import Annotated

from stepbus_schemas import Message, Point, Quaternion, meta


class BodyStates(Message, frozen=True):
    """True poses and velocities of the root links of the bodies that the description names."""

    position: Annotated[list[Point], meta("position of the root's frame: x, y, z", "m", "n 3")]
    orientation: Annotated[
        list[Quaternion], meta("orientation of the root's frame: quaternion x, y, z, w", "-", "n 4")
    ]
    velocity: Annotated[list[Point], meta("velocity of the centre of mass", "m/s", "n 3")]
    spin: Annotated[list[Point], meta("angular velocity", "rad/s", "n 3")]


class SceneChange(Message, frozen=True):
    """Changes of a scene that take effect at once, in this order."""

    bodies: Annotated[list[str], meta("bodies that are put somewhere, at rest")] = []
    position: Annotated[list[Point], meta("where the root's frame of each is put", "m", "k 3")] = []
    orientation: Annotated[
        list[Quaternion], meta("its orientation: quaternion x, y, z, w", "-", "k 4")
    ] = []
    joints: Annotated[list[str], meta("joints that are put somewhere, at rest")] = []
    joint_position: Annotated[list[float], meta("where each is put", "rad", "j")] = []
    held: Annotated[
        list[str], meta("bodies that are fixed to the link `holders` from now on, as they are")
    ] = []
    holders: Annotated[list[str], meta("link that holds each; empty: it is let go", "", "h")] = []


class RemoteCalls(Message, frozen=True):
    """Calls of a script since the step before, in the order in which each was first answered."""

    calls: Annotated[list[str], meta("client, function and arguments", "", "k")] = []
    times: Annotated[list[int], meta("how often it was called", "-", "k")] = []


class Drawings(Message, frozen=True):
    """All that a script draws, when it changes."""

    objects: Annotated[
        list[str],
        meta(
            "of each: points, lines, triangles or strip (a polyline); size of a point [m] or width "
            "of a line [pixel]; red, green, blue, 0 to 1; number of points; link in whose frame it "
            "is, if any",
            "",
            "k",
        ),
    ] = []
    points: Annotated[list[Point], meta("all points: x, y, z", "m", "j 3")] = []
